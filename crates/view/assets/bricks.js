/** Number of points along a brick, and number of bytes of a brick with one byte per point. */
const POINTS = 9, BRICK_BYTES = POINTS ** 3;

/** Interleaves `planes` values of each point, which are stored one plane after another as differences along rows. */
function fromRows(stored, planes) {
  const points = stored.length / planes, bytes = new Uint8Array(stored.length);
  for (let k = 0, from = 0; k < planes; k++)
    for (let i = 0, last = 0; i < points; i++, from++) {
      last = ((i % POINTS === 0 ? 0 : last) + stored[from]) & 255;
      bytes[planes * i + k] = last;
    }
  return bytes;
}

/** Hands a baked field's bricks to the shader: each at its place in textures that hold all of them. */
function loadBricks(viewer, scene, part, texture) {
  const { gl } = viewer, { grid, atlas } = scene, occupied = part('occupied');
  const numbers = new Uint16Array(grid[0] * grid[1] * grid[2]);
  let count = 0;
  for (let cell = 0; cell < numbers.length; cell++)
    if ((occupied[cell >> 3] >> (cell & 7)) & 1) numbers[cell] = ++count;
  texture('bricks', gl.TEXTURE_3D, gl.NEAREST, () =>
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R16UI, ...grid, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, numbers));
  for (const [name, planes] of [['opacities', 1], ['reds', 4], ['greens', 4], ['blues', 4]]) {
    const [kind, order] = planes === 1 ? [gl.R8, gl.RED] : [gl.RGBA8, gl.RGBA];
    const bytes = fromRows(part(name), planes), length = planes * BRICK_BYTES;
    texture(name, gl.TEXTURE_3D, gl.LINEAR, () => {
      gl.texStorage3D(gl.TEXTURE_3D, 1, kind, ...atlas.map((bricks) => POINTS * bricks));
      for (let brick = 0; brick < count; brick++) {
        const at = [brick % atlas[0], Math.floor(brick / atlas[0]) % atlas[1], Math.floor(brick / (atlas[0] * atlas[1]))];
        gl.texSubImage3D(gl.TEXTURE_3D, 0, ...at.map((place) => POINTS * place), POINTS, POINTS, POINTS, order,
          gl.UNSIGNED_BYTE, bytes.subarray(length * brick, length * (brick + 1)));
      }
    });
  }
}
