"""The page of `lensfield lens fit --kit`: how to take the photographs that rims are fitted to and checked by."""

KIT = """# Photographs of a lens

`lensfield lens fit` finds the rims of your copy from pictures of an even field. Half an hour and a tripod are enough.

## The even field

1. **Camera**: raw files, the lowest ISO, lens corrections off, long-exposure noise reduction off, mechanical shutter.
2. **Surface**: a computer screen that shows white, switched to full brightness; or the clear sky in the opposite
   direction of the sun, through a sheet of white paper in front of the lens. Put a white acrylic sheet or two sheets
   of paper in between, close to the lens, so that nothing of the surface is in focus.
3. **Focus**: set to infinity, by hand. Do not change it between the pictures. For other distances, take another series,
   and name it by `--focus 0.8m`.
4. **Exposure**: the middle at a half of saturation, in every picture. Screens flicker: 1/30 s or longer.
5. **Stops**: the widest, then every full stop, and one or two between the first three. The darkening that is left at
   f/11 is not from the rims; it is needed to separate what the camera's pixels do.

   | widest | pictures at |
   |---|---|
   | f/1.2 | 1.2, 1.4, 1.8, 2, 2.8, 4, 5.6, 11 |
   | f/1.4 | 1.4, 1.8, 2, 2.8, 4, 5.6, 11 |
   | f/2 | 2, 2.4, 2.8, 4, 5.6, 8, 11 |
   | f/2.8 | 2.8, 3.3, 4, 5.6, 8, 11 |
   | f/4 | 4, 4.8, 5.6, 8, 11 |

6. **Turn the camera by half a turn** and repeat the widest stop: if the brighter side turns with the camera, it is the
   lens or the camera; if not, it is the light, whose tilt the fit takes out.

Then:

    lensfield lens fit NAME --flat IMG_01.dng IMG_02.dng IMG_03.dng -o MINE.toml

A lens without contacts reports no f-stop: add `--f-numbers 2,2.8,4`, in the order of the files, `--flat` before
`--points`. A sensor of another size than the lens is made for: `--camera-sensor 23.5x15.6`.

## A distant point, to check the rims

Photograph a small lamp, such as a torch, at 30 m or more at night, out of focus: set the lens to its closest distance.
Put the lamp in the middle, half way to a corner, and as close to the corner as its disc remains complete, at the widest
stop and a stop below. Expose the disc at a half of saturation, and let no other lamp be in the picture. The discs are
the shapes of the light that the rims pass: cat's eyes.

    lensfield lens fit NAME --flat IMG_01.dng IMG_02.dng IMG_03.dng --points IMG_11.dng IMG_12.dng -o MINE.toml
    lensfield lens fit MINE.toml --points IMG_11.dng IMG_12.dng

The first command compares them with the lens before and after the fit, and the second with a fitted lens. Differences
of more than a few standard deviations show that your copy has other rims.

## A slanted edge, to check the focus and the copy

Print a black square, fix it to a wall at 40 focal lengths, turned by 5 degrees, and photograph it in the middle and in
all four corners at the widest stop and at f/8. Edges that differ between the corners show tilted or decentred elements
of your copy: the fit then describes the mean of its sides.
"""
