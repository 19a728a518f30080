// The little programs that draw a scene: points (and the rays of a selected one), frusta as lines, one photograph.

export const POINTS = {
  vertex: `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 color;
uniform mat4 clip_from_world;
uniform float size_px;
uniform int selected;
uniform vec3 accent;
out vec4 tint;
void main() {
  gl_Position = clip_from_world * vec4(position, 1.0);
  bool is_selected = gl_VertexID == selected;
  gl_PointSize = is_selected ? size_px + 8.0 : size_px;
  // A selected point is seen through what lies in front of it.
  if (is_selected) gl_Position.z = -gl_Position.w;
  tint = is_selected ? vec4(accent, 1.0) : color;
  // Filtered points carry no alpha: they are moved out of sight.
  if (color.a == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`,
  fragment: `#version 300 es
precision highp float;
in vec4 tint;
uniform float size_px;
out vec4 pixel;
void main() {
  vec2 from_center = gl_PointCoord - 0.5;
  if (size_px > 2.0 && dot(from_center, from_center) > 0.25) discard;
  pixel = vec4(tint.rgb, 1.0);
}`,
};

export const LINES = {
  vertex: `#version 300 es
layout(location = 0) in vec3 corner;
layout(location = 1) in vec4 row_x;
layout(location = 2) in vec4 row_y;
layout(location = 3) in vec4 row_z;
layout(location = 4) in vec4 shape;
layout(location = 5) in vec4 color;
uniform mat4 clip_from_world;
uniform float size;
out vec4 tint;
void main() {
  // A corner is (±1, ±1, 1) or the centre; shape: half width and height over focal length, principal point.
  vec3 p = size * vec3(corner.xy * shape.xy + corner.z * shape.zw, corner.z);
  vec3 world = vec3(dot(row_x, vec4(p, 1.0)), dot(row_y, vec4(p, 1.0)), dot(row_z, vec4(p, 1.0)));
  gl_Position = clip_from_world * vec4(world, 1.0);
  tint = color;
  if (color.a == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`,
  fragment: `#version 300 es
precision highp float;
in vec4 tint;
out vec4 pixel;
void main() { pixel = tint; }`,
};

/** The selected photograph on the far side of its frustum, half transparent: one compares it with what lies behind. */
export const PHOTO = {
  vertex: `#version 300 es
layout(location = 0) in vec2 corner;
uniform vec4 row_x;
uniform vec4 row_y;
uniform vec4 row_z;
uniform vec4 shape;
uniform mat4 clip_from_world;
uniform float size;
out vec2 at;
void main() {
  vec4 p = vec4(size * vec3(corner * shape.xy + shape.zw, 1.0), 1.0);
  gl_Position = clip_from_world * vec4(dot(row_x, p), dot(row_y, p), dot(row_z, p), 1.0);
  at = 0.5 + 0.5 * corner;
}`,
  fragment: `#version 300 es
precision highp float;
in vec2 at;
uniform sampler2D photo;
out vec4 pixel;
void main() { pixel = vec4(texture(photo, at).rgb, 0.72); }`,
};

/** A frustum as line segments: four edges from the centre, the picture's border, and a tick at its upper side. */
export const FRUSTUM = new Float32Array([
  0, 0, 0, -1, -1, 1, 0, 0, 0, 1, -1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0, -1, 1, 1,
  -1, -1, 1, 1, -1, 1, 1, -1, 1, 1, 1, 1, 1, 1, 1, -1, 1, 1, -1, 1, 1, -1, -1, 1,
  -0.35, -1, 1, 0, -1.35, 1, 0, -1.35, 1, 0.35, -1, 1,
]);

/** @param {WebGL2RenderingContext} gl @param {{vertex: string, fragment: string}} source */
export function link(gl, source) {
  const program = gl.createProgram();
  for (const [kind, text] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, source.vertex], [gl.FRAGMENT_SHADER, source.fragment]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`the viewer's shader does not link: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}
