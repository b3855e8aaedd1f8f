// Turns to other cameras and modes while part of an image is drawn, with every fence 400 ms late, and counts the pixels at
// rest that differ from an image drawn in one go.
const { viewer } = stage, { gl, canvas } = viewer, ticking = setInterval(() => {}, 1), cases = [];
// Frames follow a timer instead of the display.
self.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
viewer.waiting = false;
const signalled = gl.clientWaitSync.bind(gl);
gl.clientWaitSync = (...of) =>
  performance.now() - viewer.fence.started < 400 ? gl.TIMEOUT_EXPIRED : signalled(...of);
const until = (holds) => new Promise((done) => {
  const poll = setInterval(() => holds() && done(clearInterval(poll)), 1);
});
const read = (target) => {
  const bytes = new Uint8Array(4 * canvas.width * canvas.height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  return bytes;
};
const different = (a, b) => a.reduce((count, byte, i) => count + (Math.abs(byte - b[i]) > 2), 0);
let last = null;
for (const [camera, mode] of [[1, 0], [1, 1], [2, 1], [2, 2], [0, 2], [0, 0]]) {
  viewer.changed();
  viewer.rowsPerMs = 1;
  await until(() => viewer.fence && viewer.rows > 0 && viewer.rows < canvas.height);
  stage.goTo(camera);
  viewer.mode = mode;
  viewer.rowsPerMs = 100;
  stage.moved();
  await until(() => !viewer.fence && viewer.rows === canvas.height);
  const whole = viewer.target();
  whole.resize(canvas.width, canvas.height);
  viewer.render(whole, 0, canvas.height);
  const [shown, expected] = [viewer.fine, whole].map(read);
  cases.push({ camera, mode, mixed: different(shown, expected), changed: last ? different(expected, last) : 1 });
  last = expected;
}
clearInterval(ticking);
root.dataset.cases = JSON.stringify(cases);
