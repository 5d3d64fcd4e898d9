// The means of 2 x 2 pixels, separately for light from before and from behind the focus, if it is blurred. In each, the
// last number is the share that it covers; the third image has its blur, times that share.
void main()
{
  ivec2 first = 2 * ivec2(gl_FragCoord.xy), last = textureSize(light, 0) - 1;
  nearer = farther = blurs = vec4(0.0);
  for (int n = 0; n < 4; n++) {
    vec4 found = texelFetch(light, min(first + ivec2(n % 2, n / 2), last), 0);
    vec2 share = smoothstep(SHARP_PX, BLURRED_PX, found.a * vec2(1.0, -1.0)) / 4.0;
    nearer += share.x * vec4(found.rgb, 1.0);
    farther += share.y * vec4(found.rgb, 1.0);
    blurs.xy += share * abs(found.a);
  }
}
