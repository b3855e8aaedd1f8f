const DRAW = `#version 300 es
precision highp float;
uniform vec3 eye;
uniform mat3 axes;
uniform vec4 lens;
uniform vec2 size;
uniform float before;
layout(location = 0) in vec3 place;
layout(location = 1) in vec2 corner;
out vec3 at;
out vec2 uv;
void main() {
  vec3 p = (place - eye) * axes;
  float depth = -p.z;
  gl_Position = vec4((2.0 * lens.z / size.x - 1.0) * depth + 2.0 * lens.x / size.x * p.x,
    (1.0 - 2.0 * lens.w / size.y) * depth + 2.0 * lens.y / size.y * p.y, depth - 2.0 * before, depth);
  at = place;
  uv = corner;
}`;
const INK = `#version 300 es
precision highp float;
uniform vec3 eye;
uniform vec2 size;
uniform float reach, textured;
uniform sampler2D depths, image;
in vec3 at;
in vec2 uv;
out vec4 color;
void main() {
  vec4 seen = texture(depths, gl_FragCoord.xy / size);
  float distance = dot(seen.rgb, vec3(1.0, 1.0 / 255.0, 1.0 / 65025.0)) * reach;
  bool hidden = seen.a > 0.5 && distance < length(at - eye);
  vec4 ink = textured > 0.5 ? vec4(texture(image, uv).rgb, 0.9) : vec4(0.04, 0.42, 0.74, 1.0);
  color = vec4(ink.rgb, hidden ? 0.15 * ink.a : ink.a);
}`;

/** Training cameras as frusta with their images, faint behind the scene. */
class Overlay {
  constructor(viewer) {
    this.viewer = viewer;
    this.on = false;
    this.program = viewer.program(DRAW, INK);
    const { gl } = viewer;
    this.vertices = gl.createVertexArray();
    this.buffer = gl.createBuffer();
    gl.bindVertexArray(this.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    [[0, 3, 0], [1, 2, 12]].forEach(([index, count, offset]) => {
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, count, gl.FLOAT, false, 20, offset);
    });
    gl.bindVertexArray(null);
    this.images = [];
  }

  load(scene, images) {
    const { gl } = this.viewer;
    for (const texture of this.images) gl.deleteTexture(texture);
    this.images = images.map((image) => {
      const texture = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
      this.viewer.filter(gl.TEXTURE_2D, gl.LINEAR);
      return texture;
    });
    this.cameras = scene.cameras.map((camera) => ({ eye: camera.pose.slice(12, 15), vertices: frustum(camera, 0.12 * scene.radius) }));
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(this.cameras.flatMap((camera) => camera.vertices)), gl.STATIC_DRAW);
  }

  /** Draws over the canvas; `target` has the scene's depth. */
  draw(target) {
    if (!this.on || !this.cameras) return;
    const { gl, canvas, camera, scene } = this.viewer, { program } = this;
    gl.useProgram(program);
    gl.bindVertexArray(this.vertices);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.viewer.setCamera(program, canvas.width, canvas.height);
    gl.uniform2f(program.at('size'), canvas.width, canvas.height);
    gl.uniform1f(program.at('before'), 0.01 * scene.radius);
    gl.uniform1i(program.at('depths'), 0);
    gl.uniform1i(program.at('image'), 1);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, target.textures[1]);
    gl.activeTexture(gl.TEXTURE1);
    this.cameras.forEach((one, i) => {
      // From a camera's own place its image would cover everything.
      if (norm(minus(one.eye, camera.eye)) < 0.02 * scene.radius) return;
      gl.bindTexture(gl.TEXTURE_2D, this.images[i]);
      gl.uniform1f(program.at('textured'), 1);
      gl.drawArrays(gl.TRIANGLES, i * 22, 6);
      gl.uniform1f(program.at('textured'), 0);
      gl.drawArrays(gl.LINES, i * 22 + 6, 16);
    });
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }
}

/** Decodes the training images of a scene. */
const decodedImages = (scene) => Promise.all(scene.cameras.map(async (camera) => {
  const image = new Image();
  image.src = camera.image;
  await image.decode();
  return image;
}));

/** Makes two triangles and eight lines of a camera whose image is at depth `depth`: place and texture coordinates of each end. */
function frustum({ pose, lens: [fx, fy, cx, cy], width, height }, depth) {
  const axes = [0, 4, 8].map((i) => pose.slice(i, i + 3)), eye = pose.slice(12, 15);
  const corner = (u, v) => {
    const local = [(u * width - cx) / fx, (cy - v * height) / fy, -1];
    return [...axes.reduce((sum, axis, i) => add(sum, times(axis, local[i] * depth)), eye), u, v];
  };
  const corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)], apex = [...eye, 0, 0];
  const sides = corners.flatMap((from, i) => [apex, from, from, corners[(i + 1) % 4]]);
  return [...[0, 1, 2, 0, 2, 3].map((i) => corners[i]), ...sides].flat();
}
