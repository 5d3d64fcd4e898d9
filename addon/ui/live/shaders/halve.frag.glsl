// The means of 2 x 2 pixels of three images.
void main()
{
  ivec2 first = 2 * ivec2(gl_FragCoord.xy), last = textureSize(finer_blurs, 0) - 1;
  nearer = farther = blurs = vec4(0.0);
  for (int n = 0; n < 4; n++) {
    ivec2 place = min(first + ivec2(n % 2, n / 2), last);
    nearer += texelFetch(finer_nearer, place, 0) / 4.0;
    farther += texelFetch(finer_farther, place, 0) / 4.0;
    blurs += texelFetch(finer_blurs, place, 0) / 4.0;
  }
}
