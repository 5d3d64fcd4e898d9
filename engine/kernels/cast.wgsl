// Cast: the loop of cast.c on a graphics processor. The comments there explain the method; here, an invocation follows
// all rays of a pixel, one after the other, so that its sums have a fixed order. Results differ from C by rounding.
//
// gpu_cast.py puts lines before this text: GROUP, the invocations of a workgroup; WAVELENGTHS, their number; and MESH,
// whether nodes of rays are in a mesh. Workgroups are parts of tiles, because tiles whose pixels are cast at a distance
// have too few for all threads; a second pass therefore fills the pixels between them.

const BLOCKED = 2e-3;
const APART = 0.25;

// The floats of an eight of rays: see enum in cast.c.
const STOP_TWO = 0u;
const STOP_ONE = 8u;
const OF_STOP = 16u;
const FAR_ONE = 0u;
const FAR_TWO = 8u;
const MOVED_ONE = 16u;
const MOVED_TWO = 24u;
const CELLS_INSIDE = 32u;
const WEIGHT = 40u;
const OF_WAVELENGTH = 48u;
const OF_EIGHT = OF_STOP + OF_WAVELENGTH * WAVELENGTHS;

struct Casting {
    // of `lens`: the rays' nodes, columns of a mesh or heights; their eights; and where the tables begin
    nodes: u32, eights: u32, mesh_rows: u32, finer: u32,
    chief: u32, shrinkage: u32, shrinkage_steps: u32, blade: u32,
    blades: u32, mirrored_right: u32, mirrored_up: u32, layers: u32,
    levels: u32, columns: u32, // of a layer; of the picture
    centre_row: i32, centre_column: i32, // of the axis, and the parts of a pixel beyond
    centre_row_part: f32, centre_column_part: f32,
    nodes_per_px: f32, rows_per_px: f32, first_right: f32, first_up: f32,
    per_focal_right: f32, per_focal_up: f32,
    blade_margin: f32, blade_bend: f32, blade_slope: f32, cell_of_eight: f32,
    faint: array<vec4<f32>, 2>,
}
// of workgroups, and of a tile's eights; and the first row and the rows of the picture in `pictures`
struct Call { first_group: u32, first_eight: u32, most_eights: u32, top: u32, rows: u32 }
struct Level {
    light: u32, alpha: u32, depth: u32, rows: u32, columns: u32, // where the planes begin; depth: of the first level
    axis_row: f32, axis_column: f32, per_px: f32,
    top: f32, bottom: f32, left: f32, right: f32,
}
struct Meeting { inverse_depth: f32, share: f32, steps: i32, focused: i32, is_opaque: i32, level: i32, cells: f32 }
struct Tile {
    row: u32, column: u32, height: u32, width: u32, // in the picture
    step: u32, tall: u32, wide: u32, // distance between pixels that are cast, and their rows and columns
    first_eight: u32, eights: u32, focused: u32,
    meetings: u32, first_pixel: u32, // where those of the tile begin, in `sums`
}
struct Group { tile: u32, first_pixel: u32 }

@group(0) @binding(0) var<uniform> c: Casting;
@group(0) @binding(1) var<uniform> call: Call;
@group(0) @binding(2) var<storage, read> lens: array<f32>;
@group(0) @binding(3) var<storage, read> light: array<f32>;
@group(0) @binding(4) var<storage, read> depths: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> levels: array<Level>;
@group(0) @binding(6) var<storage, read> meetings: array<Meeting>;
@group(0) @binding(7) var<storage, read> tiles: array<Tile>;
@group(0) @binding(8) var<storage, read> groups: array<Group>;
@group(0) @binding(9) var<storage, read_write> sums: array<vec4<f32>>; // (pixel that is cast, wavelength): see below
@group(0) @binding(10) var<storage, read_write> pictures: array<f32>; // (radiance and clear share, row, column)

struct Pixel {
    low: u32, high: u32, above: u32,
    weight: f32, up_weight: f32,
    right: vec2<f32>, up: vec2<f32>,
    cells: f32,
    chief: array<vec2<f32>, WAVELENGTHS>,
}
struct Pencil { // rays at a wavelength
    far: vec2<f32>, by: vec2<f32>, light: f32, free: f32, in_focus: f32,
}
struct Spot { inside: bool, at: u32, right: f32, down: f32 }
struct Node { before: u32, weight: f32 }


// Of `sums`, over the rays of a pixel at a wavelength.
const LIGHT = 0u;
const BLURRED = 1u;
const THROUGH = 2u;
const ALL = 3u;

// Also of NaN: b
fn larger(a: f32, b: f32) -> f32 { return select(b, a, a > b); }
fn smaller(a: f32, b: f32) -> f32 { return select(b, a, a < b); }
fn between(a: f32, b: f32, weight: f32) -> f32 { return a + weight * (b - a); }
fn within_one(a: f32) -> f32 { return larger(smaller(a, 1.0), 0.0); }

fn shrunk(square: f32) -> f32 {
    let tangent = sqrt(square);
    let last = f32(c.shrinkage_steps);
    let step = smaller(tangent / (1.0 + tangent) * last, last);
    let before = min(u32(step), c.shrinkage_steps - 1u);
    return between(lens[c.shrinkage + before], lens[c.shrinkage + before + 1u], step - f32(before));
}

fn place(far: vec2<f32>, by: vec2<f32>, depth: f32) -> vec2<f32> {
    var at = far + by * depth;
    if (c.per_focal_up > 0.0) {
        let tangents = at * vec2<f32>(c.per_focal_right, c.per_focal_up);
        at *= shrunk(tangents.x * tangents.x + tangents.y * tangents.y);
    }
    return at;
}

// Inverse depth and focus share where a ray meets a layer.
fn meet(fine: Level, m: Meeting, far: vec2<f32>, by: vec2<f32>) -> vec2<f32> {
    var here = vec2<f32>(m.inverse_depth, m.share);
    var before = here;
    for (var n = 0; n < m.steps; n++) {
        let at = place(far, by, here.x);
        let x = larger(smaller(fine.axis_column + 0.5 + at.x, f32(fine.columns - 1u)), 0.0);
        let y = larger(smaller(fine.axis_row + 0.5 - at.y, f32(fine.rows - 1u)), 0.0);
        before = here;
        here = depths[fine.depth + u32(y) * fine.columns + u32(x)];
        if (here.x == before.x) { return here; }
    }
    if (m.steps < 2) { return here; }
    let change = before.x - here.x;
    let moved = by * change;
    if (moved.x * moved.x + moved.y * moved.y > APART) {
        if (change > 0.0) { return before; }
        return here;
    }
    return 0.5 * (before + here);
}

fn part_beyond(distance: f32, cells: f32) -> f32 { return within_one(distance * cells + (0.5 - 0.5 * cells)); }

fn find_spot(l: Level, far: vec2<f32>, by: vec2<f32>, depth: f32, cells: f32) -> Spot {
    let at = place(far, by, depth);
    var x = l.axis_column + l.per_px * at.x;
    var y = l.axis_row - l.per_px * at.y;
    let inside = x > l.left && x < l.right && y > l.top && y < l.bottom;
    x = larger(smaller(x, f32(l.columns - 1u)), 0.0);
    y = larger(smaller(y, f32(l.rows - 1u)), 0.0);
    let column = min(u32(x), l.columns - 2u);
    let row = min(u32(y), l.rows - 2u);
    return Spot(inside, row * l.columns + column,
                part_beyond(x - f32(column), cells), part_beyond(y - f32(row), cells));
}

fn looked_up(plane: u32, columns: u32, s: Spot) -> f32 {
    let at = plane + s.at;
    let left = between(light[at], light[at + columns], s.down);
    let right = between(light[at + 1u], light[at + columns + 1u], s.down);
    return between(left, right, s.right);
}

fn open_share(cells_inside: f32) -> f32 { return within_one(cells_inside + 0.5); }

fn between_blades(here: ptr<function, Pixel>, second: f32, first: f32) -> f32 {
    let x = second * (*here).right.y + first * (*here).right.x;
    let y = first * (*here).up.x + second * (*here).up.y;
    var open = 1.0;
    for (var n = c.blade; n < c.blade + 2u * c.blades; n += 2u) {
        let along = x * lens[n] + y * lens[n + 1u];
        open *= open_share((c.blade_margin - c.blade_bend * (x * x + y * y) - c.blade_slope * along) * (*here).cells);
    }
    return open;
}

fn at_pixel(here: ptr<function, Pixel>, at: u32, weight: f32, up_weight: f32) -> f32 {
    let below = between(lens[(*here).low + at], lens[(*here).high + at], weight);
    if (!MESH) { return below; }
    let above = at + (*here).above;
    return between(below, between(lens[(*here).low + above], lens[(*here).high + above], weight), up_weight);
}

// A position to the right and up, from the sums of its two components.
fn turned(here: ptr<function, Pixel>, a: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(a.x * (*here).right.x + a.y * (*here).right.y, a.x * (*here).up.x + a.y * (*here).up.y);
}

// Follows the ray whose floats begin at `first` in the node of a pixel.
fn follow(here: ptr<function, Pixel>, first: u32, tile: Tile, sum: ptr<function, array<vec4<f32>, WAVELENGTHS>>) {
    let weight = (*here).weight;
    let up_weight = (*here).up_weight;
    let held = select(smaller(weight, 1.0), within_one(weight), MESH);
    let up_held = within_one(up_weight);
    let stop = (*here).low + first;
    let through = between_blades(here, lens[stop + STOP_TWO], lens[stop + STOP_ONE]);
    var pencils: array<Pencil, WAVELENGTHS>;
    var open = false;
    for (var w = 0u; w < WAVELENGTHS; w++) {
        let at = first + OF_STOP + OF_WAVELENGTH * w;
        var far = vec2<f32>(at_pixel(here, at + FAR_ONE, weight, up_weight),
                            at_pixel(here, at + FAR_TWO, weight, up_weight));
        if (MESH) { far += (*here).chief[w]; }
        let by = vec2<f32>(at_pixel(here, at + MOVED_ONE, weight, up_weight),
                           at_pixel(here, at + MOVED_TWO, weight, up_weight));
        let part = open_share(at_pixel(here, at + CELLS_INSIDE, held, up_held)) * through;
        let free = select(0.0, 1.0, part > 0.0);
        let of_cell = select(0.0, part * at_pixel(here, at + WEIGHT, held, up_held), part > 0.0);
        pencils[w] = Pencil(turned(here, far), turned(here, by), of_cell, free, free);
        open = open || part > 0.0;
        (*sum)[w][LIGHT] += of_cell;
    }
    for (var n = 0u; n < c.layers && open; n++) {
        let m = meetings[tile.meetings + n];
        if (m.steps < 0) { continue; }
        let met = meet(levels[n * c.levels], m, pencils[WAVELENGTHS / 2u].far, pencils[WAVELENGTHS / 2u].by);
        let share = met.y;
        if (!(share >= 0.0)) { continue; }
        let level = levels[n * c.levels + u32(m.level)];
        open = false;
        for (var w = 0u; w < WAVELENGTHS; w++) {
            let spot = find_spot(level, pencils[w].far, pencils[w].by, met.x, m.cells);
            if (spot.inside || m.is_opaque != 0) {
                var alpha = 1.0;
                if (m.is_opaque == 0) { alpha = looked_up(level.alpha, level.columns, spot); }
                let radiance = looked_up(level.light + w * level.rows * level.columns, level.columns, spot);
                let visible = pencils[w].free * pencils[w].light;
                if (tile.focused != 0u) {
                    let sharp = visible * share;
                    let bright = radiance + c.faint[w / 4u][w % 4u] * alpha;
                    (*sum)[w][BLURRED] += (visible - sharp) * radiance;
                    (*sum)[w][THROUGH] += sharp * bright;
                    (*sum)[w][ALL] += pencils[w].in_focus * pencils[w].light * share * bright;
                    let in_focus = pencils[w].in_focus - pencils[w].in_focus * share * alpha;
                    pencils[w].in_focus = select(0.0, in_focus, in_focus > BLOCKED);
                } else {
                    (*sum)[w][BLURRED] += visible * radiance;
                }
                let free = pencils[w].free - pencils[w].free * alpha;
                pencils[w].free = select(0.0, free, free > BLOCKED);
            }
            open = open || select(pencils[w].free, pencils[w].in_focus, tile.focused != 0u) > 0.0;
        }
    }
}

fn node_before(at: f32, count: u32) -> Node {
    let before = clamp(floor(at), 0.0, f32(count - 2u));
    return Node(u32(before), at - before);
}

fn pair(at: u32) -> vec2<f32> { return vec2<f32>(lens[at], lens[at + 1u]); }

fn find_chief(here: ptr<function, Pixel>, right: f32, up: f32) {
    let size = 2u * WAVELENGTHS;
    let columns = (c.nodes - 1u) * c.finer + 1u;
    let across = node_before(right, columns);
    let upwards = node_before(up, (c.mesh_rows - 1u) * c.finer + 1u);
    let a = c.chief + (upwards.before * columns + across.before) * size;
    let b = a + columns * size;
    for (var w = 0u; w < WAVELENGTHS; w++) {
        let low = pair(a + 2u * w) + across.weight * (pair(a + 2u * w + size) - pair(a + 2u * w));
        let high = pair(b + 2u * w) + across.weight * (pair(b + 2u * w + size) - pair(b + 2u * w));
        (*here).chief[w] = low + upwards.weight * (high - low);
    }
}

fn pixel_of(row: u32, column: u32, cells: f32) -> Pixel {
    let x = f32(i32(column) - c.centre_column) - c.centre_column_part;
    let y = f32(c.centre_row - i32(row)) + c.centre_row_part;
    let node = c.eights * OF_EIGHT;
    var here: Pixel;
    here.cells = cells;
    if (MESH) {
        let side = vec2<f32>(select(1.0, -1.0, c.mirrored_right != 0u && x < 0.0),
                             select(1.0, -1.0, c.mirrored_up != 0u && y < 0.0));
        let right = side.x * x * c.nodes_per_px - c.first_right;
        let up = side.y * y * c.rows_per_px - c.first_up;
        let across = node_before(right, c.nodes);
        let upwards = node_before(up, c.mesh_rows);
        here.above = c.nodes * node;
        here.low = across.before * node + upwards.before * here.above;
        here.weight = across.weight;
        here.up_weight = upwards.weight;
        find_chief(&here, right * f32(c.finer), up * f32(c.finer));
        here.right = vec2<f32>(side.x, 0.0);
        here.up = vec2<f32>(0.0, side.y);
    } else {
        let height = sqrt(x * x + y * y);
        let outwards = node_before(height * c.nodes_per_px, c.nodes);
        here.low = outwards.before * node;
        here.weight = outwards.weight;
        here.right = vec2<f32>(0.0, 1.0);
        if (height > 0.0) { here.right = vec2<f32>(x, y) / height; }
        here.up = vec2<f32>(here.right.y, -here.right.x);
    }
    here.high = here.low + node;
    return here;
}

// Adds rays of pixels to their sums. Each workgroup casts pixels of a tile next to each other.
@compute @workgroup_size(GROUP)
fn cast_pixels(@builtin(workgroup_id) group_of_call: vec3<u32>, @builtin(local_invocation_index) number: u32) {
    let group = groups[call.first_group + group_of_call.x];
    let tile = tiles[group.tile];
    let pixel = group.first_pixel + number;
    if (pixel >= tile.tall * tile.wide) { return; }
    let cells = sqrt(f32(tile.eights)) / c.cell_of_eight;
    var here = pixel_of(tile.row + pixel / tile.wide * tile.step, tile.column + pixel % tile.wide * tile.step, cells);
    var sum: array<vec4<f32>, WAVELENGTHS>;
    let end = tile.first_eight + min(call.first_eight + call.most_eights, tile.eights);
    for (var n = tile.first_eight + call.first_eight; n < end; n++) {
        for (var ray = 0u; ray < 8u; ray++) { follow(&here, n * OF_EIGHT + ray, tile, &sum); }
    }
    let to = (tile.first_pixel + pixel) * WAVELENGTHS;
    for (var w = 0u; w < WAVELENGTHS; w++) { sums[to + w] += sum[w]; }
}

// Radiance and clear share of a pixel at a wavelength.
fn divided(sum: vec4<f32>, focused: bool) -> vec2<f32> {
    var of_pixel = vec2<f32>(0.0, 1.0);
    if (sum[LIGHT] > 0.0) { of_pixel.x = sum[BLURRED] / sum[LIGHT]; }
    if (focused && sum[ALL] > 0.0) { of_pixel.y = within_one(sum[THROUGH] / sum[ALL]); }
    return of_pixel;
}

struct Crossing { before: u32, after: u32, weight: f32 }

fn crossing_of(pixel: u32, step: u32, count: u32) -> Crossing {
    let before = pixel / step;
    return Crossing(before, min(before + 1u, count - 1u), f32(pixel % step) / f32(step));
}

// Writes the pixels of a tile, interpolated between those that are cast.
@compute @workgroup_size(GROUP)
fn fill_tiles(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) number: u32) {
    let tile = tiles[group.x];
    let focused = tile.focused != 0u;
    for (var pixel = number; pixel < tile.height * tile.width; pixel += GROUP) {
        let row = pixel / tile.width;
        let column = pixel % tile.width;
        let x = crossing_of(column, tile.step, tile.wide);
        let y = crossing_of(row, tile.step, tile.tall);
        let above = tile.first_pixel + y.before * tile.wide;
        let below = tile.first_pixel + y.after * tile.wide;
        for (var w = 0u; w < WAVELENGTHS; w++) {
            let above_left = divided(sums[(above + x.before) * WAVELENGTHS + w], focused);
            let above_right = divided(sums[(above + x.after) * WAVELENGTHS + w], focused);
            let below_left = divided(sums[(below + x.before) * WAVELENGTHS + w], focused);
            let below_right = divided(sums[(below + x.after) * WAVELENGTHS + w], focused);
            let upper = above_left + x.weight * (above_right - above_left);
            let lower = below_left + x.weight * (below_right - below_left);
            let filled = upper + y.weight * (lower - upper);
            let to = (w * call.rows + tile.row - call.top + row) * c.columns + tile.column + column;
            pictures[to] = filled.x;
            pictures[to + WAVELENGTHS * call.rows * c.columns] = filled.y;
        }
    }
}
