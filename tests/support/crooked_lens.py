"""An anamorphic lens of every kind of surface, each displaced, with a displaced stop and a tilted sensor."""

from lensfield.engine.prescription.prescription import Pose, Prescription, Surface

SURFACES = (
    Surface(-40.0, 3.0, "1.6/40", radius_x_mm=-25.0, conic=-0.5, aspheric=(0.0, 1e-5), skews=(0.0, 0.4),
            pose=Pose((0.2, -0.1, 0.05), (1.0, -2.0, 3.0))),
    Surface(60.0, 8.0, radius_x_mm=35.0, profile="y", aspheric=(0.0, -2e-5), pose=Pose(tilt_deg=(0.0, 1.5, -20.0))),
    Surface(thickness_mm=1.0, stop=True, pose=Pose((0.3, 0.2, -0.1), (4.0, -3.0, 0.0))),
    Surface(thickness_mm=4.0, glass="1.5/60", radius_x_mm=80.0, profile="x", conic_x=-1.0),
    Surface(-18.0, 40.0, conic=-0.3, semi_aperture_mm=6.0, pose=Pose((-0.4, 0.3, 0.0), (-2.0, 0.0, 10.0))))
CROOKED = Prescription("crooked", SURFACES, ("stop", 4.0), ("angle_deg", 10.0),
                       image_pose=Pose((0.5, -0.3, 0.2), (8.0, -5.0, 30.0)))
