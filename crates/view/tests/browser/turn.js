// Turns to the right and up until the camera stops, and measures its angles to the training cameras' mean.
const { camera } = stage.viewer, angles = [];
for (const [right, down] of [[0.1, 0], [0, -0.1]]) {
  stage.goTo(0);
  for (let i = 0; i < 60; i++) camera.orbit(right, down);
  angles.push(camera.offMiddle(camera.back));
}
root.dataset.turned = JSON.stringify({ angles, limit: camera.limit });
