! Exports the lens that is open in Zemax OpticStudio (sequential mode) for lensfield.
!
! For every field height and wavelength: a Huygens PSF about the chief ray, the height at which the chief ray really
! meets the image surface, and the relative illumination; with them the first-order data of the lens.
!
! Options used (made by lensfield lens export-macro zemax):
!   field heights          @{heights}, from 0 to @{last_height_text}
!   wavelengths            @{waves}, from @{first_nm} to @{last_nm} nm
!   PSF                    @{psf_samples} x @{psf_samples} samples, @{pitch_um} um apart
!   pupil sampling         @{pupil_samples} x @{pupil_samples}
!   sensor                 @{sensor_text}
!
! Written from the documented commands of ZPL and tested only against recorded exports, not in the program itself.
!
! Before: save the lens. Make a folder beside the lens file, named like it with -lensfield added: for TRIPLET.ZMX the
! folder TRIPLET-lensfield. Nothing is written outside this folder. Surfaces that vignette need fixed apertures:
! vignetting is set from them for every field. Ray aiming stays as it is; turn it on where the pupil is aberrated.
!
! The macro takes one wavelength at a time as the primary one, with fields as paraxial image heights; at the end it
! puts fields, field type and wavelengths back. Comments and pickups of fields are lost, and a macro that is stopped
! half way puts nothing back: reopen the lens then. Heights are those of the reference wavelength, the primary one of
! the lens; at the other wavelengths each field keeps its object point, so that lateral colour is in the real heights.
! An aperture defined by an F-number follows the wavelength by a little: better define it by the entrance pupil.

heights_n = @{heights}
waves_n = @{waves}
last_mm = @{last_height}
pitch_um = @{pitch_um}
! Zemax counts sampling in doublings: 1 for 32 x 32, 2 for 64 x 64, ...
psf_code = @{psf_doublings}
pupil_code = @{pupil_doublings}
sensor_w_mm = @{sensor_width}
sensor_h_mm = @{sensor_height}
DECLARE nm_of, DOUBLE, 1, @{waves}
@{wavelength_lines}

DECLARE real_of, DOUBLE, 1, @{points}
DECLARE light_of, DOUBLE, 1, @{points}
DECLARE old_x, DOUBLE, 1, 200
DECLARE old_y, DOUBLE, 1, 200
DECLARE old_weight, DOUBLE, 1, 200
DECLARE old_vdx, DOUBLE, 1, 200
DECLARE old_vdy, DOUBLE, 1, 200
DECLARE old_vcx, DOUBLE, 1, 200
DECLARE old_vcy, DOUBLE, 1, 200
DECLARE old_van, DOUBLE, 1, 200
DECLARE old_um, DOUBLE, 1, 24
DECLARE old_um_weight, DOUBLE, 1, 24

lens_file$ = $FILENAME()
stem_n = SLEN(lens_file$) - 4
lens_stem$ = $LEFTSTRING(lens_file$, stem_n)
out_folder$ = $PATHNAME() + "\" + lens_stem$ + "-lensfield"
toml_file$ = out_folder$ + "\lens.toml"
lens_name$ = $LENSNAME()
IF (SLEN(lens_name$) == 0)
  lens_name$ = lens_stem$
ENDIF

failed_n = 0
GOSUB check_lens
IF (failed_n == 0)
  GOSUB mark_unfinished
  GOSUB remember_system
  GOSUB measure_lens
  IF (failed_n == 0)
    GOSUB trace_all
  ENDIF
  GOSUB restore_system
ENDIF
IF (failed_n == 0)
  GOSUB write_tables
  GOSUB write_description
  PRINT "The lens is exported to ", out_folder$
  PRINT "Next: lensfield lens import ", out_folder$, " -o ", lens_stem$, ".npz"
ENDIF
BEEP
END


! What would make the export wrong, before anything is touched.
SUB check_lens
  FORMAT 3.1
  half_text$ = $STR(0.5)
  IF (half_text$ $== "0,5")
    PRINT "Stopped: numbers are printed with a decimal comma. Set a decimal point in the regional settings."
    failed_n = 1
  ENDIF
  IF (SYPR(30) != 0)
    PRINT "Stopped: the lens units are not millimetres. Scale a copy of the lens to millimetres."
    failed_n = 1
  ENDIF
  IF (NFLD() > 200)
    PRINT "Stopped: more than 200 fields, which this macro could not put back. Delete some in a copy of the lens."
    failed_n = 1
  ENDIF
  IF (NWAV() > 24)
    PRINT "Stopped: more than 24 wavelengths, which this macro could not put back."
    failed_n = 1
  ENDIF
  IF (SYPR(70) == 0)
    PRINT "Note: ray aiming is off. With an aberrated pupil the chief ray then misses the middle of the stop."
  ENDIF
RETURN


! An export that is stopped half way must not look like a whole one; and a missing folder shows here, at once.
SUB mark_unfinished
  OUTPUT toml_file$
  PRINT "unfinished = true"
  OUTPUT SCREEN
RETURN


SUB remember_system
  old_type = SYPR(100)
  old_fields = NFLD()
  FOR f_i = 1, old_fields, 1
    old_x(f_i) = FLDX(f_i)
    old_y(f_i) = FLDY(f_i)
    old_weight(f_i) = FWGT(f_i)
    old_vdx(f_i) = FVDX(f_i)
    old_vdy(f_i) = FVDY(f_i)
    old_vcx(f_i) = FVCX(f_i)
    old_vcy(f_i) = FVCY(f_i)
    old_van(f_i) = FVAN(f_i)
  NEXT
  old_waves = NWAV()
  ref_w = PWAV()
  FOR w_i = 1, old_waves, 1
    old_um(w_i) = WAVL(w_i)
    old_um_weight(w_i) = WWGT(w_i)
  NEXT
RETURN


SUB restore_system
  SYSP 100, old_type
  SYSP 101, old_fields
  FOR f_i = 1, old_fields, 1
    SYSP 102, f_i, old_x(f_i)
    SYSP 103, f_i, old_y(f_i)
    SYSP 104, f_i, old_weight(f_i)
    SYSP 105, f_i, old_vdx(f_i)
    SYSP 106, f_i, old_vdy(f_i)
    SYSP 107, f_i, old_vcx(f_i)
    SYSP 108, f_i, old_vcy(f_i)
    SYSP 109, f_i, old_van(f_i)
  NEXT
  SYSP 201, old_waves
  FOR w_i = 1, old_waves, 1
    SYSP 202, w_i, old_um(w_i)
    SYSP 203, w_i, old_um_weight(w_i)
  NEXT
  SYSP 200, ref_w
  UPDATE
RETURN


! First-order data at the reference wavelength; the F-number is 0.5 / NA of the real marginal ray on the axis.
SUB measure_lens
  ref_um = WAVL(ref_w)
  object_mm = THIC(0)
  pupil_mm = OPEV(OCOD("ENPP"), 0, 0, 0, 0, 0, 0)
  efl_mm = OPEV(OCOD("EFFL"), 0, ref_w, 0, 0, 0, 0)
  mag_n = OPEV(OCOD("PMAG"), 0, ref_w, 0, 0, 0, 0)
  IF (last_mm == 0)
    last_mm = ABSO(OPEV(OCOD("PIMH"), 0, ref_w, 0, 0, 0, 0))
  ENDIF
  IF (last_mm == 0)
    PRINT "Stopped: all fields lie on the axis. Give the last height: --last-height."
    failed_n = 1
  ENDIF
  GOSUB sum_lens
  first_sum = lens_sum

  PWAV 1
  NUMWAVE 1
  WAVL 1 = ref_um
  PWAV 1
  SYSP 100, 2
  NUMFIELD 1
  FLDX 1 = 0
  FLDY 1 = 0
  SETVIG
  UPDATE
  RAYTRACE 0, 0, 0, 1
  IF (RAYE() != 0)
    PRINT "Stopped: the marginal ray on the axis does not reach the image."
    failed_n = 1
  ELSE
    f_number = 0.5 / ABSO(RAYM(NSUR()))
  ENDIF
RETURN


! A number that changes when solves change the lens with the wavelength or the field.
SUB sum_lens
  lens_sum = 0
  last_s = NSUR() - 1
  FOR s_i = 1, last_s, 1
    lens_sum = lens_sum + s_i * (THIC(s_i) + CURV(s_i))
  NEXT
RETURN


! Field 1 is traced; field 2 stays on the axis, to compare its illumination.
SUB trace_all
  NUMFIELD 2
  FLDX 1 = 0
  FLDX 2 = 0
  FLDY 2 = 0
  SETVIG
  UPDATE
  settings_file$ = out_folder$ + "\huygens.cfg"
  psf_file$ = out_folder$ + "\psf_1_1.txt"
  ! Flag 0 takes the default settings and writes them down; the listing itself is written again below.
  GETTEXTFILE psf_file$, Hps, settings_file$, 0
  MODIFYSETTINGS settings_file$, HPS_PUPILSAMP, pupil_code
  MODIFYSETTINGS settings_file$, HPS_IMAGESAMP, psf_code
  MODIFYSETTINGS settings_file$, HPS_IMAGEDELTA, pitch_um
  FOR w_i = 1, waves_n, 1
    IF (failed_n == 0)
      WAVL 1 = nm_of(w_i) / 1000
      UPDATE
      GOSUB scale_fields
      FORMAT 8.2
      value_n = nm_of(w_i)
      PRINT "Wavelength ", value_n, " nm"
    ENDIF
    FOR h_i = 1, heights_n, 1
      IF (failed_n == 0)
        GOSUB trace_point
      ENDIF
    NEXT
  NEXT
RETURN


! The paraxial image of one object point lies at another height at another wavelength.
SUB scale_fields
  IF (ABSO(object_mm) > 1000000000)
    scale_n = OPEV(OCOD("EFFL"), 0, 1, 0, 0, 0, 0) / efl_mm
  ELSE
    scale_n = OPEV(OCOD("PMAG"), 0, 1, 0, 0, 0, 0) / mag_n
  ENDIF
RETURN


SUB trace_point
  FLDY 1 = scale_n * last_mm * (h_i - 1) / (heights_n - 1)
  SETVIG
  UPDATE
  GOSUB sum_lens
  IF (ABSO(lens_sum - first_sum) > 0.000000001)
    PRINT "Stopped: solves change the lens with wavelength or field. Make them fixed in a copy of the lens."
    failed_n = 1
  ENDIF
  RAYTRACE 0, 1, 0, 0
  IF (RAYE() != 0)
    FORMAT 12.6
    value_n = FLDY(1)
    PRINT "Stopped: the chief ray is lost at height ", value_n, " mm. Give a smaller last height: --last-height."
    failed_n = 1
  ENDIF
  axis_light = RELI(2)
  IF (axis_light == 0)
    PRINT "Stopped: no light on the axis."
    failed_n = 1
  ENDIF
  IF (failed_n == 0)
    point_i = (h_i - 1) * waves_n + w_i
    real_of(point_i) = RAYY(NSUR())
    light_of(point_i) = RELI(1) / axis_light
    FORMAT .0
    psf_file$ = out_folder$ + "\psf_" + $STR(h_i) + "_" + $STR(w_i) + ".txt"
    GETTEXTFILE psf_file$, Hps, settings_file$, 1
  ENDIF
RETURN


! A row for each height, a column for each wavelength.
SUB write_tables
  FORMAT .9 EXP
  table_file$ = out_folder$ + "\real_height.txt"
  OUTPUT table_file$
  FOR h_i = 1, heights_n, 1
    FOR w_i = 1, waves_n, 1
      point_i = (h_i - 1) * waves_n + w_i
      value_n = real_of(point_i)
      PRINT value_n, " ",
    NEXT
    PRINT " "
  NEXT
  table_file$ = out_folder$ + "\ri.txt"
  OUTPUT table_file$
  FOR h_i = 1, heights_n, 1
    FOR w_i = 1, waves_n, 1
      point_i = (h_i - 1) * waves_n + w_i
      value_n = light_of(point_i)
      PRINT value_n, " ",
    NEXT
    PRINT " "
  NEXT
  OUTPUT SCREEN
RETURN


SUB write_description
  point_i = heights_n * waves_n
  side_text$ = "+y"
  IF (real_of(point_i) < 0)
    side_text$ = "-y"
  ENDIF
  FORMAT .9 EXP
  OUTPUT toml_file$
  PRINT "format = 'lensfield-export'"
  PRINT "version = 1"
  PRINT "program = 'zemax'"
  PRINT "name = '''", lens_name$, "'''"
  PRINT "source = 'exported from Zemax OpticStudio by the macro of lensfield'"
  PRINT "notes = '''lens file ", lens_file$, "'''"
  PRINT "efl_mm = ", efl_mm
  PRINT "magnification = ", mag_n
  PRINT "f_number_effective = ", f_number
  PRINT "entrance_pupil_mm = ", pupil_mm
  value_n = 1000 * ref_um
  PRINT "reference_wavelength_nm = ", value_n
  IF (ABSO(object_mm) > 1000000000)
    PRINT "object_distance_mm = inf"
  ELSE
    PRINT "object_distance_mm = ", object_mm
  ENDIF
  IF (sensor_w_mm > 0)
    PRINT "sensor_mm = [", sensor_w_mm, ", ", sensor_h_mm, "]"
  ENDIF
  PRINT "wavelengths_nm = ["
  FOR w_i = 1, waves_n, 1
    value_n = nm_of(w_i)
    PRINT value_n, ","
  NEXT
  PRINT "]"
  PRINT "heights_mm = ["
  FOR h_i = 1, heights_n, 1
    value_n = last_mm * (h_i - 1) / (heights_n - 1)
    PRINT value_n, ","
  NEXT
  PRINT "]"
  PRINT "image_side = '", side_text$, "'"
  PRINT "real_height = 'real_height.txt'"
  PRINT "relative_illumination = 'ri.txt'"
  PRINT "psf = 'psf_{height}_{wavelength}.txt'"
  OUTPUT SCREEN
RETURN
