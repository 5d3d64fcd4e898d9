// Levels of layers on a graphics processor: the functions of levels.py, whose comments explain the method. Results differ
// from numpy by rounding. gpu_levels.py puts lines before this text: WIDE and TALL, the sides of workgroups in pixels.
//
// Each pass writes a stack of planes from others: the light of some wavelengths, and alpha as the last plane.

const SHARPER = 1.0 / 12.0;
const ROUNDING = 1e-6;
const VISIBLE = 1e-3;

struct Pass {
    source: u32, to: u32, other: u32, // where the planes begin
    source_rows: u32, source_columns: u32, rows: u32, columns: u32, other_rows: u32, other_columns: u32,
    first_row: u32, // of those that are written
    other_row: i32, other_column: i32, // of the first pixel in the plane of `other`
    along_columns: u32, // of a filter, or from row to row
    step: i32, before: i32, taps: u32, // pixel n is the sum of pixels from step * n - before on
    on_before: u32, on_behind: u32, // whether the last pixels continue; otherwise 0
    alpha: u32, // the plane
    near_px: f32,
    weights: array<vec4<f32>, 4>,
}

@group(0) @binding(1) var<uniform> c: Pass;
@group(0) @binding(2) var<storage, read> source: array<f32>;
@group(0) @binding(3) var<storage, read> other: array<f32>;
@group(0) @binding(4) var<storage, read_write> to: array<f32>;

fn pixel(plane: u32, row: u32, column: u32) -> f32 {
    let at = (plane * c.source_rows + min(row, c.source_rows - 1u)) * c.source_columns;
    return source[c.source + at + min(column, c.source_columns - 1u)];
}

fn is_outside(id: vec3<u32>) -> bool { return c.first_row + id.y >= c.rows || id.x >= c.columns; }
fn place_of(id: vec3<u32>) -> u32 { return c.to + (id.z * c.rows + c.first_row + id.y) * c.columns + id.x; }

fn beside(id: vec3<u32>, along: u32) -> f32 {
    let row = c.first_row + id.y;
    if (c.along_columns != 0u) { return pixel(id.z, row, along); }
    return pixel(id.z, along, id.x);
}

// Weighted sums along rows or columns. Along the others, the last pixel continues.
@compute @workgroup_size(WIDE, TALL)
fn filter_planes(@builtin(global_invocation_id) id: vec3<u32>) {
    if (is_outside(id)) { return; }
    let first = c.step * i32(select(c.first_row + id.y, id.x, c.along_columns != 0u)) - c.before;
    let count = i32(select(c.source_rows, c.source_columns, c.along_columns != 0u));
    var sum = 0.0;
    for (var k = 0u; k < c.taps; k++) {
        let at = first + i32(k);
        let inside = (at >= 0 || c.on_before != 0u) && (at < count || c.on_behind != 0u);
        if (inside) { sum += c.weights[k / 4u][k % 4u] * beside(id, u32(clamp(at, 0, count - 1))); }
    }
    to[place_of(id)] = sum;
}

fn moved(before: f32, behind: f32) -> f32 {
    return clamp(SHARPER * (behind - before), -0.5 * abs(behind), 0.5 * abs(before));
}

// Planes with light moved to brighter neighbours, along rows or columns.
@compute @workgroup_size(WIDE, TALL)
fn sharpen(@builtin(global_invocation_id) id: vec3<u32>) {
    if (is_outside(id)) { return; }
    let last = select(c.source_rows, c.source_columns, c.along_columns != 0u) - 1u;
    let at = min(select(c.first_row + id.y, id.x, c.along_columns != 0u), last);
    var value = beside(id, at);
    if (at < last) { value -= moved(beside(id, at), beside(id, at + 1u)); }
    if (at > 0u) { value += moved(beside(id, at - 1u), beside(id, at)); }
    to[place_of(id)] = value;
}

// The visible part of a pixel of the capture. `source` is the cover of nearer layers, `other` how far they are.
@compute @workgroup_size(WIDE, TALL)
fn find_visible(@builtin(global_invocation_id) id: vec3<u32>) {
    if (is_outside(id)) { return; }
    let row = c.first_row + id.y;
    let apart = other[c.other + row * c.columns + id.x];
    to[place_of(id)] = 1.0 - select(0.0, pixel(0u, row, id.x), apart <= c.near_px);
}

fn of_other(row: u32, column: u32) -> f32 {
    return other[c.other + u32(i32(row) + c.other_row) * c.other_columns + u32(i32(column) + c.other_column)];
}

// Planes times the visible share of what the layer covers. `other` is the visible part of the capture.
@compute @workgroup_size(WIDE, TALL)
fn leave_out_hidden(@builtin(global_invocation_id) id: vec3<u32>) {
    if (is_outside(id)) { return; }
    let row = c.first_row + id.y;
    let part = min(1.0, of_other(row, id.x) / max(pixel(c.alpha, row, id.x), ROUNDING));
    to[place_of(id)] = part * pixel(id.z, row, id.x);
}

// Replaces means by those of visible parts, where `other`, the level of what is visible, is not too dark.
@compute @workgroup_size(WIDE, TALL)
fn divide(@builtin(global_invocation_id) id: vec3<u32>) {
    if (is_outside(id)) { return; }
    let share = of_other(c.first_row + id.y, id.x);
    if (share > VISIBLE) { to[place_of(id)] = pixel(id.z, c.first_row + id.y, id.x) / share; }
}
