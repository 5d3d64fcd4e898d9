// The means of three images around each pixel, which fall off to `reach` pixels beyond a box of that size.
void main()
{
  ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(sharper_blurs, 0) - 1;
  nearer = farther = blurs = vec4(0.0);
  for (int up = -1; up <= 1; up++) {
    for (int right = -1; right <= 1; right++) {
      ivec2 place = clamp(here + int(reach) * ivec2(right, up), ivec2(0), last);
      float share = float((2 - abs(right)) * (2 - abs(up))) / 16.0;
      nearer += share * texelFetch(sharper_nearer, place, 0);
      farther += share * texelFetch(sharper_farther, place, 0);
      blurs += share * texelFetch(sharper_blurs, place, 0);
    }
  }
}
