// The viewport's light, and the blur in pixels of what is there: positive nearer than the focus.
void main()
{
  ivec2 here = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depths, here, 0).r * 2.0 - 1.0;
  float nearness = (depth + focus.x) * focus.y; // per metre
  result = vec4(texelFetch(colours, here, 0).rgb, clamp(focus.z * (nearness - focus.w), -most_px, most_px));
}
