/** Hands a factored field's tables and its MLP to the shader. */
function loadTables(viewer, scene, part, texture) {
  const { gl, field } = viewer, { levels, layers, lineWidth } = scene, network = part('network'), byte = gl.UNSIGNED_BYTE;
  if (network.length > gl.getParameter(gl.MAX_UNIFORM_BLOCK_SIZE))
    throw new CannotDraw(`This graphics card cannot hold the field's MLP of ${network.length} bytes.`);
  levels.forEach((size, i) => texture(`planes${i}`, gl.TEXTURE_2D_ARRAY, gl.LINEAR, () =>
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, size, size, layers, 0, gl.RGBA, byte, part(`planes${i}`))));
  texture('lines', gl.TEXTURE_2D, gl.LINEAR, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, lineWidth, levels.length * layers, 0, gl.RGBA, byte, part('lines')));
  [['Network', network], ['Offsets', part('offsets')]].forEach(([name, data], i) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.UNIFORM_BUFFER, buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, data, gl.STATIC_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, i, buffer);
    gl.uniformBlockBinding(field, gl.getUniformBlockIndex(field, name), i);
    viewer.buffers.push(buffer);
  });
}
