// The viewport's light, and the blur in pixels of what is there: positive nearer than the focus, which may lean.
void main()
{
  ivec2 here = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depths, here, 0).r * 2.0 - 1.0;
  float nearness = (depth + focus.x) * focus.y; // per metre
  float in_focus = focus.w + dot(lean, gl_FragCoord.xy);
  result = vec4(texelFetch(colours, here, 0).rgb, clamp(focus.z * (nearness - in_focus), -most_px, most_px));
}
