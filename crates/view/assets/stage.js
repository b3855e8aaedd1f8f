/**
 * Canvas with its controls, training images, and message where a browser cannot draw. Its `twin`, if it has one, is another
 * stage under the same camera, which follows every movement and setting.
 */
class Stage {
  constructor(root) {
    this.root = root;
    this.twin = null;
    this.canvas = this.find('canvas');
    this.viewer = new Viewer(this.canvas);
    this.listen();
    this.fold();
  }

  find(selector) {
    return this.root.querySelector(selector);
  }

  /** Shows a scene with its title and images. Returns false if another scene is to be loaded before this one is unpacked. */
  async load(scene, keepCamera) {
    if (!(await this.viewer.load(scene, keepCamera))) return false;
    this.find('.poster')?.remove();
    this.find('.message').hidden = true;
    this.canvas.hidden = false;
    for (const selector of ['.tools', '.help']) this.find(selector).hidden = false;
    describe(this.root, scene, (index) => this.goTo(index));
    return true;
  }

  /** Draws again, here and on the twin, after the camera or a setting changed. */
  moved() {
    const { viewer, twin } = this;
    viewer.changed();
    if (!twin?.viewer.scene) return;
    twin.viewer.camera.restore(viewer.camera.state());
    twin.viewer.mode = viewer.mode;
    twin.viewer.overlay.on = viewer.overlay.on;
    twin.viewer.changed();
  }

  /** Goes to a training camera. */
  goTo(index) {
    const { viewer } = this;
    viewer.camera.take(viewer.scene.cameras[index]);
    this.moved();
  }

  /** Draws the field alone in `size`² pixels, as base64 of RGBA. */
  pixels(size) {
    return btoa(Array.from(this.viewer.pixels(size, size), (byte) => String.fromCharCode(byte)).join(''));
  }

  /** Folds controls, note and images on narrow screens, where they open on demand. */
  fold() {
    const tools = this.find('.tools'), narrow = matchMedia('(max-width: 640px)');
    const fold = () => (tools.open = !narrow.matches);
    tools.addEventListener('toggle', () => this.root.classList.toggle('folded', !tools.open));
    narrow.addEventListener('change', fold);
    fold();
    this.root.classList.toggle('folded', !tools.open);
  }

  listen() {
    const { viewer, canvas } = this, pointers = new Map();
    const group = `mode${[...document.querySelectorAll('.stage')].indexOf(this.root)}`;
    this.find('.modes').replaceChildren(...MODES.map((name, i) => {
      const label = document.createElement('label'), input = document.createElement('input');
      Object.assign(input, { type: 'radio', name: group, value: name, checked: i === 0 });
      input.addEventListener('change', () => {
        viewer.mode = i;
        this.moved();
      });
      label.append(input, ` ${name}`);
      return label;
    }));
    this.find('.frusta').addEventListener('change', (event) => {
      viewer.overlay.on = event.target.checked;
      this.moved();
    });
    this.find('.reset').addEventListener('click', () => this.goTo(0));
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener('pointermove', (event) => {
      const last = pointers.get(event.pointerId);
      if (!last || !viewer.scene) return;
      const others = [...pointers.values()].filter((other) => other.pointerId !== event.pointerId);
      const [x, y] = [event.clientX - last.clientX, event.clientY - last.clientY];
      const size = [canvas.clientWidth, canvas.clientHeight];
      if (others.length > 0) {
        const span = (pointer) => Math.hypot(pointer.clientX - others[0].clientX, pointer.clientY - others[0].clientY);
        viewer.camera.pan(x / 2, y / 2, ...size);
        viewer.camera.zoom(span(last) / Math.max(1, span(event)));
      } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey) {
        viewer.camera.pan(x, y, ...size);
      } else {
        const angle = Math.PI / Math.min(...size);
        viewer.camera.orbit(x * angle, y * angle);
      }
      pointers.set(event.pointerId, event);
      this.moved();
    });
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      if (!viewer.scene) return;
      viewer.camera.zoom(Math.exp(Math.max(-100, Math.min(100, event.deltaY)) * 0.002));
      this.moved();
    }, { passive: false });
    canvas.addEventListener('keydown', (event) => {
      const step = 0.1, keys = {
        ArrowLeft: () => viewer.camera.orbit(-step, 0), ArrowRight: () => viewer.camera.orbit(step, 0),
        ArrowUp: () => viewer.camera.orbit(0, -step), ArrowDown: () => viewer.camera.orbit(0, step),
        '+': () => viewer.camera.zoom(0.9), '-': () => viewer.camera.zoom(1.1),
      };
      if (!keys[event.key] || !viewer.scene) return;
      event.preventDefault();
      keys[event.key]();
      this.moved();
    });
  }
}

/** Shows a scene's title, note and training images; a click on an image calls `chosen` with its index. */
function describe(root, scene, chosen) {
  root.querySelector('h1').textContent = scene.title;
  root.querySelector('.note').textContent = scene.note;
  const strip = root.querySelector('.strip');
  strip.hidden = false;
  strip.replaceChildren(...scene.cameras.map((camera, index) => {
    const button = document.createElement('button'), image = document.createElement('img');
    Object.assign(image, { src: camera.image, alt: `training image ${camera.name}` });
    Object.assign(button, { type: 'button', title: camera.name });
    button.append(image);
    button.addEventListener('click', () => chosen(index));
    return button;
  }));
}

/** Shows the reason why the scene cannot be drawn, and the images instead. */
function showFallback(root, error, scene) {
  const message = root.querySelector('.message');
  message.textContent = error instanceof CannotDraw ? error.message : `The scene cannot be drawn: ${error.message}`;
  message.hidden = false;
  root.querySelector('canvas').hidden = true;
  if (scene) describe(root, scene, () => {});
}
