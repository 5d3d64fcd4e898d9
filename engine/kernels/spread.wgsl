// Spread: the loop of spreading.c on a graphics processor. The comments there explain the tables of PSFs. Here, an
// invocation gathers all light that reaches a pixel of the picture, so that its sum has a fixed order. Results differ
// from C by rounding.
//
// gpu_spread.py puts lines before this text: WIDE and TALL, the sides of workgroups in pixels; PLANES, the number of
// planes that share PSFs; CELLS, whether pixels are in cells of a grid, instead of between heights and azimuths; and
// MOST_TAPS, in a piece.

const DARK = 0xffffffffu; // in place of an interval
const ATAN_TERMS = 14u;

struct Spreading {
    rows: u32, columns: u32, side: u32, intervals: u32, // of a plane of light; of the PSFs' square; of the table
    section_px: u32, section_columns: u32,
    azimuths: u32, quarter_steps: u32, // of the table
    heights: u32, samples: u32, // of the table; steps of the curve of heights
    centre_row: i32, centre_column: i32, // of the axis, and the parts of a pixel beyond
    centre_row_part: f32, centre_column_part: f32, samples_per_px: f32,
}
struct Call { first_row: u32, first_of_square: u32, most_of_square: u32 } // in `picture`, and rows of the PSFs' square
struct Interval { begin: u32, length: u32 } // in `taps`: first tap, and taps of a PSF
// Taps in a row of PSFs. Those of pieces with MOST_TAPS begin at `full` in the PSF, with three more for each piece; of
// the last piece, at `last`, minus those in the pieces before it.
struct Span { column: u32, count: u32, full: u32, last: u32 }
struct Place { interval: u32, psf: u32, up: f32, on: f32 } // the first of four PSFs, and fractions on to the others

@group(0) @binding(0) var<uniform> c: Spreading;
@group(0) @binding(1) var<uniform> call: Call;
@group(0) @binding(2) var<storage, read> taps: array<f32>;
@group(0) @binding(3) var<storage, read> intervals: array<Interval>;
@group(0) @binding(4) var<storage, read> spans: array<Span>; // (interval, row), and a last interval with the taps of any
@group(0) @binding(5) var<storage, read> steps: array<u32>; // (sample): intervals; or of rows and columns of pixels
@group(0) @binding(6) var<storage, read> curve: array<f32>; // (sample), and (height); or of rows and columns, on to nodes
@group(0) @binding(7) var<storage, read> lit: array<u32>; // (section row, section column)
@group(0) @binding(8) var<storage, read> light: array<f32>; // (plane, row, column)
@group(0) @binding(9) var<storage, read_write> places: array<Place>; // (row, column)
@group(0) @binding(10) var<storage, read_write> picture: array<f32>; // (plane, row, column), with a margin

fn arctan(t: f32) -> f32 { // from 0 to 1; the language's own is too inaccurate
    var term = array<f32, ATAN_TERMS>(0.9999999999982004, -0.3333333326254709, 0.1999999534286548, -0.1428559243462209,
        0.1110942872658185, -0.09076800877134047, 0.0761425741442088, -0.06366109812151624, 0.05045587086468524,
        -0.03526805537018975, 0.0199376976275484, -0.008242022886406635, 0.002162828043635403, -0.0002666058550987925);
    var sum = 0.0;
    for (var k = ATAN_TERMS; k > 0u; k--) { sum = sum * t * t + term[k - 1u]; }
    return t * sum;
}

// Steps of the table from the azimuth to the right, clockwise.
fn azimuth_of(right: f32, down: f32) -> f32 {
    let quarter = f32(c.quarter_steps);
    let far = abs(vec2<f32>(right, down));
    var azimuth = arctan(min(far.x, far.y) / max(max(far.x, far.y), 1e-20)) * quarter * 0.63661977;
    if (far.y > far.x) { azimuth = quarter - azimuth; }
    if (right < 0.0) { azimuth = 2.0 * quarter - azimuth; }
    if (down < 0.0) { azimuth = 4.0 * quarter - azimuth; }
    return clamp(azimuth, 0.0, f32(c.azimuths - 1u));
}

fn place_between_heights(row: u32, column: u32) -> Place {
    let right = f32(i32(column) - c.centre_column) - c.centre_column_part;
    let down = f32(i32(row) - c.centre_row) - c.centre_row_part;
    let azimuth = azimuth_of(right, down);
    let before = min(u32(azimuth), c.azimuths - 2u);
    let at = min(sqrt(right * right + down * down) * c.samples_per_px, f32(c.samples));
    let sample = min(u32(at), c.samples - 1u);
    let height = curve[sample] + (at - f32(sample)) * (curve[sample + 1u] - curve[sample]);
    let heights = c.samples + 1u;
    var below = steps[sample];
    if (below < c.heights - 2u && height >= curve[heights + below + 1u]) { below++; }
    let low = curve[heights + below];
    let up = clamp((height - low) / (curve[heights + below + 1u] - low), 0.0, 1.0);
    return Place(below, intervals[below].begin + before * intervals[below].length, up, azimuth - f32(before));
}

fn place_in_cell(row: u32, column: u32) -> Place {
    let cell = steps[row] + steps[c.rows + column];
    return Place(cell, intervals[cell].begin, curve[row], curve[c.rows + column]);
}

// Finds the PSFs of pixels with light in lit sections.
@compute @workgroup_size(WIDE, TALL)
fn find_places(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.y;
    let column = id.x;
    if (row >= c.rows || column >= c.columns) { return; }
    let pixel = row * c.columns + column;
    var any = false;
    for (var q = 0u; q < PLANES; q++) { any = any || light[q * c.rows * c.columns + pixel] != 0.0; }
    if (!any || lit[row / c.section_px * c.section_columns + column / c.section_px] == 0u) {
        places[pixel].interval = DARK;
    } else if (CELLS) {
        places[pixel] = place_in_cell(row, column);
    } else {
        places[pixel] = place_between_heights(row, column);
    }
}

fn between(at: u32, step: u32, weight: f32) -> f32 { return (1.0 - weight) * taps[at] + weight * taps[at + step]; }

// Adds the light that some rows of the PSFs' square bring to pixels of the picture.
@compute @workgroup_size(WIDE, TALL)
fn gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = call.first_row + id.y;
    let column = id.x;
    let tall = c.rows + c.side - 1u;
    let wide = c.columns + c.side - 1u;
    if (row >= tall || column >= wide) { return; }
    let to = row * wide + column;
    var sum: array<f32, PLANES>;
    for (var q = 0u; q < PLANES; q++) { sum[q] = picture[q * tall * wide + to]; } // of the rows before
    let end_of_square = min(call.first_of_square + call.most_of_square, c.side);
    for (var n = call.first_of_square; n < end_of_square; n++) {
        let from_row = row - n;
        if (from_row >= c.rows) { continue; } // also above the light, where it wraps around
        let any = spans[c.intervals * c.side + n];
        let first = max(any.column, max(column, c.columns - 1u) - (c.columns - 1u));
        let end = min(any.column + any.count, column + 1u);
        var of_row = array<f32, PLANES>(); // explicitly: without a value, the next turn begins with the last one's
        var interval = DARK;
        var length = 0u;
        var span = any;
        for (var m = first; m < end; m++) {
            let pixel = from_row * c.columns + column - m;
            let place = places[pixel];
            if (place.interval == DARK) { continue; }
            if (place.interval != interval) {
                interval = place.interval;
                length = intervals[interval].length;
                span = spans[interval * c.side + n];
            }
            let along = m - span.column;
            if (along >= span.count) { continue; } // also before the span, where it wraps around
            let piece = along / MOST_TAPS;
            let at = place.psf + along + select(span.last, span.full + 3u * piece, piece < span.count / MOST_TAPS);
            let psf = (1.0 - place.up) * between(at, length, place.on)
                      + place.up * between(at + c.azimuths * length, length, place.on);
            for (var q = 0u; q < PLANES; q++) { of_row[q] += psf * light[q * c.rows * c.columns + pixel]; }
        }
        for (var q = 0u; q < PLANES; q++) { sum[q] += of_row[q]; }
    }
    for (var q = 0u; q < PLANES; q++) { picture[q * tall * wide + to] = sum[q]; }
}
