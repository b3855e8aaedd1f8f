// Moves, turns and presses all controls of a page, and writes the camera after each of them into the document.
const { canvas, viewer } = stage, seen = {};
canvas.setPointerCapture = () => {};
const twin = { scene: viewer.scene, camera: { restore: (look) => (twin.look = look) }, overlay: {}, changed: () => {} };
stage.twin = { viewer: twin };
const note = (name) => {
  const look = viewer.camera.state(), { eye, target } = look;
  const alike = JSON.stringify(look) === JSON.stringify(twin.look ?? look);
  const followed = alike && (twin.mode ?? 0) === viewer.mode && (twin.overlay.on ?? false) === viewer.overlay.on;
  seen[name] = { eye, target, mode: viewer.mode, frusta: viewer.overlay.on, followed };
};
const pointer = (type, pointerId, x, y, buttons = 1) =>
  canvas.dispatchEvent(new PointerEvent(type, { pointerId, clientX: x, clientY: y, buttons }));
const drag = (buttons) => {
  pointer('pointerdown', 1, 100, 100, buttons);
  pointer('pointermove', 1, 130, 110, buttons);
  pointer('pointerup', 1, 130, 110, 0);
};
const key = (key) => canvas.dispatchEvent(new KeyboardEvent('keydown', { key }));
note('start');
drag(1); note('turned');
stage.find('.reset').click(); note('reset');
drag(2); note('moved');
pointer('pointermove', 1, 10, 10, 0); note('let go');
canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -100 })); note('scrolled');
stage.find('.reset').click();
pointer('pointerdown', 1, 100, 100); pointer('pointerdown', 2, 140, 100); pointer('pointermove', 2, 180, 100);
pointer('pointerup', 1, 100, 100); pointer('pointerup', 2, 180, 100); note('pinched');
stage.find('.reset').click();
key('ArrowRight'); note('right'); key('+'); note('plus'); key('x'); note('another key');
stage.root.querySelectorAll('.strip button')[2].click(); note('third image');
stage.root.querySelectorAll('.modes input')[1].click(); note('depth');
stage.find('.frusta').click(); note('frusta');
root.dataset.controls = JSON.stringify(seen);
