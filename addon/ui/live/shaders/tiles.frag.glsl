// The largest and the smallest blur in a tile.
void main()
{
  ivec2 first = TILE * ivec2(gl_FragCoord.xy), last = textureSize(light, 0) - 1;
  vec2 ends = vec2(-FARTHEST, FARTHEST);
  for (int row = 0; row < TILE; row++) {
    for (int column = 0; column < TILE; column++) {
      float blur = texelFetch(light, min(first + ivec2(column, row), last), 0).a;
      ends = vec2(max(ends.x, blur), min(ends.y, blur));
    }
  }
  result = vec4(ends, 0.0, 0.0);
}
