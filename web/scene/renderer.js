// Draws points and frusta with WebGL 2, which is there also where WebGPU is not.

import { FRUSTUM, LINES, PHOTO, POINTS, link } from "./programs.js";

export class Renderer {
  /** @param {OffscreenCanvas} canvas */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser offers no WebGL 2: the scene cannot be drawn, everything else works");
    this.gl = gl;
    this.canvas = canvas;
    /** @type {[number, number, number]} */ this.background = [0.04, 0.05, 0.06];
    this.pointSize = 2;
    this.frustumSize = 1;
    this.selectedPoint = -1;
    /** @type {[number, number, number]} */ this.accent = [88, 166, 255];
    this.numPoints = 0;
    this.numRayEnds = 0;
    /** @type {{ texture: WebGLTexture, pose: Float32Array, shape: Float32Array }|null} */ this.photo = null;
    this.numCameras = 0;
    this.on = this.build();
  }

  /** After a lost context. */
  restore() {
    this.photo = null;
    this.on = this.build();
  }

  /** Everything that lives on the device. */
  build() {
    const gl = this.gl;
    const points = link(gl, POINTS);
    const lines = link(gl, LINES);
    const photo = link(gl, PHOTO);
    const [position, color, pose, shape, cameraColor, ray, rayColor] = [0, 1, 2, 3, 4, 5, 6].map(() => gl.createBuffer());
    const cornerBuffer = gl.createBuffer();
    /** @param {WebGLBuffer|null} buffer @param {number} location @param {number} size @param {number} type @param {boolean} normalized @param {number} stride @param {number} offset @param {number} divisor */
    const attribute = (buffer, location, size, type, normalized, stride, offset, divisor) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, type, normalized, stride, offset);
      gl.vertexAttribDivisor(location, divisor);
    };
    const pointArray = gl.createVertexArray();
    gl.bindVertexArray(pointArray);
    attribute(position, 0, 3, gl.FLOAT, false, 0, 0, 0);
    attribute(color, 1, 4, gl.UNSIGNED_BYTE, true, 0, 0, 0);
    const rayArray = gl.createVertexArray();
    gl.bindVertexArray(rayArray);
    attribute(ray, 0, 3, gl.FLOAT, false, 0, 0, 0);
    attribute(rayColor, 1, 4, gl.UNSIGNED_BYTE, true, 0, 0, 0);
    const lineArray = gl.createVertexArray();
    gl.bindVertexArray(lineArray);
    gl.bindBuffer(gl.ARRAY_BUFFER, cornerBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, FRUSTUM, gl.STATIC_DRAW);
    attribute(cornerBuffer, 0, 3, gl.FLOAT, false, 0, 0, 0);
    for (const row of [0, 1, 2]) attribute(pose, 1 + row, 4, gl.FLOAT, false, 48, 16 * row, 1);
    attribute(shape, 4, 4, gl.FLOAT, false, 0, 0, 1);
    attribute(cameraColor, 5, 4, gl.UNSIGNED_BYTE, true, 0, 0, 1);
    const photoArray = gl.createVertexArray();
    gl.bindVertexArray(photoArray);
    const quad = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, quad);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    attribute(quad, 0, 2, gl.FLOAT, false, 0, 0, 0);
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    /** @param {WebGLProgram} program @param {string[]} names */
    const uniforms = (program, names) => Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
    return {
      points, lines, position, color, pose, shape, cameraColor, pointArray, lineArray, ray, rayColor, rayArray,
      pointUniforms: uniforms(points, ["clip_from_world", "size_px", "selected", "accent"]),
      lineUniforms: uniforms(lines, ["clip_from_world", "size"]),
      photo, photoArray, photoUniforms: uniforms(photo, ["clip_from_world", "size", "row_x", "row_y", "row_z", "shape"]),
    };
  }

  /** @param {WebGLBuffer|null} buffer @param {ArrayBufferView} data */
  upload(buffer, data) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  }

  /** @param {Float32Array} positions @param {Uint8Array} colors rgba */
  setPoints(positions, colors) {
    this.numPoints = positions.length / 3;
    this.upload(this.on.position, positions);
    this.upload(this.on.color, colors);
  }

  /** @param {Uint8Array} colors rgba */
  setPointColors(colors) {
    this.upload(this.on.color, colors);
  }

  /** @param {Float32Array} poses @param {Float32Array} shapes @param {Uint8Array} colors rgba */
  setCameras(poses, shapes, colors) {
    this.numCameras = poses.length / 12;
    this.upload(this.on.pose, poses);
    this.upload(this.on.shape, shapes);
    this.upload(this.on.cameraColor, colors);
  }

  /** @param {Uint8Array} colors rgba */
  setCameraColors(colors) {
    this.upload(this.on.cameraColor, colors);
  }

  /** Segments from a point to its cameras. @param {Float32Array} ends xyz @param {[number, number, number]} rgb */
  setRays(ends, rgb) {
    this.numRayEnds = ends.length / 3;
    if (this.numRayEnds === 0) return;
    this.upload(this.on.ray, ends);
    this.upload(this.on.rayColor, Uint8Array.from({ length: 4 * this.numRayEnds }, (_, k) => (k % 4 === 3 ? 255 : rgb[k % 4])));
  }

  /** @param {ImageBitmap|null} picture null: none @param {Float32Array} pose 12 numbers @param {Float32Array} shape 4 numbers */
  setPhoto(picture, pose, shape) {
    const gl = this.gl;
    if (this.photo) gl.deleteTexture(this.photo.texture);
    this.photo = null;
    const texture = picture && gl.createTexture();
    if (!picture || !texture) return;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    this.photo = { texture, pose, shape };
  }

  /** @param {Float32Array} clipFromWorld */
  draw(clipFromWorld) {
    const gl = this.gl;
    if (gl.isContextLost()) return;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...this.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { on } = this;
    if (this.numPoints > 0) {
      gl.useProgram(on.points);
      gl.uniformMatrix4fv(on.pointUniforms.clip_from_world, false, clipFromWorld);
      gl.uniform1f(on.pointUniforms.size_px, this.pointSize);
      gl.uniform1i(on.pointUniforms.selected, this.selectedPoint);
      gl.bindVertexArray(on.pointArray);
      gl.uniform3f(on.pointUniforms.accent, this.accent[0] / 255, this.accent[1] / 255, this.accent[2] / 255);
      gl.drawArrays(gl.POINTS, 0, this.numPoints);
      if (this.numRayEnds > 0) {
        gl.uniform1i(on.pointUniforms.selected, -1);
        gl.uniform1f(on.pointUniforms.size_px, 1);
        gl.bindVertexArray(on.rayArray);
        gl.drawArrays(gl.LINES, 0, this.numRayEnds);
      }
    }
    if (this.numCameras > 0 && this.frustumSize > 0) {
      gl.useProgram(on.lines);
      gl.uniformMatrix4fv(on.lineUniforms.clip_from_world, false, clipFromWorld);
      gl.uniform1f(on.lineUniforms.size, this.frustumSize);
      gl.bindVertexArray(on.lineArray);
      gl.drawArraysInstanced(gl.LINES, 0, FRUSTUM.length / 3, this.numCameras);
    }
    if (this.photo && this.frustumSize > 0) {
      const { pose, shape, texture } = this.photo;
      gl.useProgram(on.photo);
      gl.uniformMatrix4fv(on.photoUniforms.clip_from_world, false, clipFromWorld);
      gl.uniform1f(on.photoUniforms.size, this.frustumSize);
      for (const [row, name] of ["row_x", "row_y", "row_z"].entries()) gl.uniform4fv(on.photoUniforms[name], pose.subarray(4 * row, 4 * row + 4));
      gl.uniform4fv(on.photoUniforms.shape, shape);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.enable(gl.BLEND);
      gl.bindVertexArray(on.photoArray);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      gl.disable(gl.BLEND);
    }
    gl.bindVertexArray(null);
  }
}
