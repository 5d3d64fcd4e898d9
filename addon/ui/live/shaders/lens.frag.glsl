// The viewport through the lens: each pixel of the frame gathers the light that the lens's rays bring there.

// A value between the nodes of a table that extends over the frame: their number down and across, the texel of the
// first, and the distance to the next in a row.
vec4 between(vec2 place, int nodes, ivec2 origin, int apart)
{
  vec2 node = place * float(nodes - 1);
  ivec2 first = clamp(ivec2(floor(node)), ivec2(0), ivec2(nodes - 2)), next = ivec2(apart, 0), above = ivec2(0, 1);
  vec2 share = node - vec2(first);
  first = origin + ivec2(apart * first.x, first.y);
  return mix(mix(texelFetch(tables, first, 0), texelFetch(tables, first + next, 0), share.x),
             mix(texelFetch(tables, first + above, 0), texelFetch(tables, first + next + above, 0), share.x), share.y);
}

// Where the viewport shows light from a direction, in pixels.
vec2 position(vec2 angle)
{
  float size = length(angle);
  return view.zw + view.xy * angle * (size < 1e-4 ? 1.0 : tan(min(size, STEEPEST)) / size);
}

bool outside(vec2 place)
{
  vec2 size = vec2(textureSize(colours, 0));
  return any(lessThan(place, vec2(0.0))) || any(greaterThanEqual(place, size));
}

// The picture between the middles of pixels; black outside.
vec4 light_at(vec2 place)
{
  if (outside(place)) {
    return vec4(0.0, 0.0, 0.0, 1.0);
  }
  vec2 from_first = place - 0.5, share = fract(from_first);
  ivec2 first = ivec2(floor(from_first)), last = textureSize(colours, 0) - 1;
  vec4 at[4];
  for (int n = 0; n < 4; n++) {
    at[n] = texelFetch(colours, clamp(first + ivec2(n % 2, n / 2), ivec2(0), last), 0);
  }
  return mix(mix(at[0], at[1], share.x), mix(at[2], at[3], share.x), share.y);
}

// The same without blurred pixels, and the share of the others.
vec4 sharp_at(vec2 place)
{
  if (outside(place)) {
    return vec4(0.0, 0.0, 0.0, 1.0);
  }
  vec2 from_first = place - 0.5, share = fract(from_first);
  ivec2 first = ivec2(floor(from_first)), last = textureSize(light, 0) - 1;
  vec4 at[4];
  for (int n = 0; n < 4; n++) {
    vec4 found = texelFetch(light, clamp(first + ivec2(n % 2, n / 2), ivec2(0), last), 0);
    at[n] = vec4(found.rgb, 1.0) * (1.0 - smoothstep(SHARP_PX, BLURRED_PX, abs(found.a)));
  }
  return mix(mix(at[0], at[1], share.x), mix(at[2], at[3], share.x), share.y);
}

// A pixel of an image, or the nearest one.
vec4 pixel_at(sampler2D image, ivec2 place)
{
  return texelFetch(image, clamp(place, ivec2(0), textureSize(image, 0) - 1), 0);
}

// Light on one side of the focus around a place, averaged over about this many pixels, with the share that it covers;
// and its blur.
vec4 side_at(vec2 place, float width, bool nearer, out float blur)
{
  ivec2 here = ivec2(floor(place));
  if (width < 1.25) {
    vec4 found = pixel_at(light, here);
    blur = nearer ? found.a : -found.a;
    return vec4(found.rgb, 1.0) * smoothstep(SHARP_PX, BLURRED_PX, blur);
  }
  vec4 found, blurs;
  if (width < 0.85 * 2.0) { // beyond, the rays' lattice would show
    found = nearer ? pixel_at(nearer_2, here / 2) : pixel_at(farther_2, here / 2);
    blurs = pixel_at(blurs_2, here / 2);
  }
  else if (width < 0.85 * 4.0) {
    found = nearer ? pixel_at(nearer_4, here / 2) : pixel_at(farther_4, here / 2);
    blurs = pixel_at(blurs_4, here / 2);
  }
  else if (width < 0.85 * 8.0) {
    found = nearer ? pixel_at(nearer_8, here / 2) : pixel_at(farther_8, here / 2);
    blurs = pixel_at(blurs_8, here / 2);
  }
  else {
    found = nearer ? pixel_at(nearer_16, here / 4) : pixel_at(farther_16, here / 4);
    blurs = pixel_at(blurs_16, here / 4);
  }
  blur = (nearer ? blurs.x : blurs.y) / max(found.a, 1e-6);
  return found;
}

// The variance of the light around a place that `side_at` averages over about this many pixels.
float variance(float width)
{
  return width < 1.25 ? VARIANCE_1 : width < 0.85 * 2.0 ? VARIANCE_2 : width < 0.85 * 4.0 ? VARIANCE_4 :
         width < 0.85 * 8.0 ? VARIANCE_8 : VARIANCE_16;
}

// The factor on distances of rays from their middle that leaves room for the variance of the light around each, where
// theirs and their cells' have this variance.
float drawn_in(float spread, float around)
{
  return sqrt(max(spread - around, 0.0) / max(spread, 1e-6) * CELLS);
}

// How rays are drawn in, as a matrix on their distances from their middle, and how far apart they are across the narrow
// side of their blur; `right` and `up` turn a ray's bends into pixels.
mat2 narrowed(vec2 place, vec4 right, vec4 up, float step, out float apart)
{
  mat4 spread = mat4(0.0);
  for (int n = 0; n < 4; n++) {
    spread[n] = between(place, BOKEH_NODES, ivec2(PATTERNS + 1 + n, 0), PATTERN);
  }
  vec3 shape = CELLS * vec3(dot(right, spread * right), dot(right, spread * up), dot(up, spread * up));
  float middle = (shape.x + shape.z) / 2.0, half_range = length(vec2(shape.x - shape.z, 2.0 * shape.y)) / 2.0;
  apart = 4.0 * CELL * sqrt(max(middle - half_range, 0.0) * step);
  float around = variance(apart), narrow = drawn_in(middle - half_range, around);
  float wide = drawn_in(middle + half_range, around);
  mat2 along_wide = mat2(shape.x - middle, shape.y, shape.y, shape.z - middle) / max(half_range, 1e-6);
  return mat2((wide + narrow) / 2.0) + (wide - narrow) / 2.0 * along_wide;
}

// Light of surfaces that are blurred up to `widest`, on its side of the focus, and the share of this place that they
// cover; and the light of others around. The frame shows `middle` at `place`.
void gather(vec2 middle, vec2 place, float widest, bool look_behind, out vec4 blurred, out vec4 others)
{
  blurred = others = vec4(0.0);
  int step = abs(widest) < FEW_RAYS_PX ? FEWER : 1;
  float least = CELL * abs(widest) * sqrt(float(step)); // the distance between the rays of a round blur
  ivec2 node = ivec2(place * float(BOKEH_NODES - 1) + 0.5);
  vec4 right = vec4(widest / 2.0, 0.0, view.x, 0.0), up = vec4(0.0, widest / 2.0, 0.0, view.y);
  vec4 own_middle = texelFetch(tables, ivec2(PATTERNS + PATTERN * node.x, node.y), 0);
  vec4 pattern_middle = between(place, BOKEH_NODES, ivec2(PATTERNS, 0), PATTERN);
  float apart;
  mat2 inwards = narrowed(place, right, up, float(step), apart);
  middle += vec2(dot(right, pattern_middle), dot(up, pattern_middle));
  float total = 0.0;
  for (int ray = 0; ray < RAYS; ray += step) {
    ivec2 entry = ivec2(2 * (node.x * RAYS + ray), node.y);
    vec4 bends = texelFetch(tables, entry, 0) - own_middle;
    vec2 light_radius = texelFetch(tables, entry + ivec2(1, 0), 0).xy;
    vec2 at = middle + inwards * vec2(dot(right, bends), dot(up, bends));
    if (light_radius.x == 0.0 || outside(at)) {
      continue;
    }
    float blur;
    vec4 found = side_at(at, apart, widest > 0.0, blur);
    float own = max(min(blur, abs(widest)), least);
    float reaches = clamp((own - light_radius.y * abs(widest)) / least + 1.0, 0.0, 1.0);
    blurred += reaches * light_radius.x * (widest * widest) / (own * own) * found;
    total += light_radius.x;
    if (look_behind) {
      vec4 here = pixel_at(light, ivec2(floor(at)));
      others += here.a < SHARP_PX ? light_radius.x * vec4(here.rgb, 1.0) : vec4(0.0);
    }
  }
  blurred /= max(total, 1e-6);
}

// Light that reaches a place of the frame from all depths, where `middle` shows its green light.
vec3 all_depths(vec2 red, vec2 middle, vec2 blue, vec2 place, vec3 picture)
{
  vec4 at_red = sharp_at(red), at_green = sharp_at(middle), at_blue = sharp_at(blue);
  vec3 sharp = vec3(at_red.r, at_green.g, at_blue.b), share = vec3(at_red.a, at_green.a, at_blue.a);
  vec2 ends = texelFetch(reaches, ivec2(middle) / TILE, 0).xy;
  bool nearer = pixel_at(light, ivec2(middle)).a > 0.0, all_sharp = all(greaterThan(share, vec3(0.999)));
  vec3 behind = picture;
  vec4 blurred = vec4(0.0), others;
  if (ends.y < -SHARP_PX && !nearer && !all_sharp) {
    gather(middle, place, ends.y, false, blurred, others);
    behind = blurred.a > 0.0 ? blurred.rgb / blurred.a : behind;
  }
  blurred = vec4(0.0);
  if (ends.x > SHARP_PX) {
    gather(middle, place, ends.x, nearer, blurred, others);
    behind = !nearer ? behind : others.a > 0.0 ? others.rgb / others.a : blurred.rgb / max(blurred.a, 1e-6);
  }
  vec3 base = sharp + (1.0 - share) * behind;
  return blurred.a > 0.0 ? mix(base, blurred.rgb / blurred.a, min(blurred.a, 1.0)) : base;
}

void main()
{
  vec2 place = (gl_FragCoord.xy - frame.xy) / frame.zw;
  vec4 red_green = between(place, NODES, ivec2(0, BOKEH_NODES), 1);
  vec4 blue_light = between(place, NODES, ivec2(NODES, BOKEH_NODES), 1);
  vec2 red = position(red_green.xy), middle = position(red_green.zw), blue = position(blue_light.xy);
  vec4 green_light = light_at(middle);
  vec3 picture = vec3(light_at(red).r, green_light.g, light_at(blue).b);
  if (has_depth > 0.5 && !outside(middle)) {
    picture = all_depths(red, middle, blue, place, picture);
  }
  picture *= blue_light.z;
  if (exposure > 0.0) {
    picture = min(exposure * picture, 1.0);
  }
  result = vec4(picture, shows_through > 0.5 ? green_light.a : 1.0);
}
