// While a render is pressed, it shows the truth instead.
for (const view of document.querySelectorAll('.view, .panel')) {
  const truth = view.querySelector('img.truth');
  if (!truth) continue;
  for (const render of view.querySelectorAll('img.render')) {
    const own = render.src;
    const show = (src) => () => { render.src = src; };
    render.classList.add('held');
    render.draggable = false;
    render.addEventListener('pointerdown', show(truth.src));
    for (const end of ['pointerup', 'pointerleave', 'pointercancel']) render.addEventListener(end, show(own));
  }
}
