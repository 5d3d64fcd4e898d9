// A rectangle of the target: its corners are given in the target's own coordinates, -1 to 1.
void main()
{
  gl_Position = vec4(corner, 0.0, 1.0);
}
