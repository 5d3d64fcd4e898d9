// The largest and the smallest blur that reaches a tile from the tiles around it.
void main()
{
  ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(tiles, 0) - 1;
  vec2 ends = texelFetch(tiles, here, 0).xy;
  for (int up = -REACH; up <= REACH; up++) {
    for (int right = -REACH; right <= REACH; right++) {
      vec2 other = texelFetch(tiles, clamp(here + ivec2(right, up), ivec2(0), last), 0).xy;
      float away = float(TILE) * length(max(abs(vec2(right, up)) - 1.0, 0.0));
      ends.x = max(ends.x, other.x * (widest / 2.0 + SPREAD) > away ? other.x : ends.x);
      ends.y = min(ends.y, -other.y * (widest / 2.0 + SPREAD) > away ? other.y : ends.y);
    }
  }
  result = vec4(ends, 0.0, 0.0);
}
