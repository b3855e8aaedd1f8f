addEventListener('load', () => {
  const width = document.documentElement.clientWidth, parts = document.querySelectorAll('h1, h2, h3, .panel img, .panel figcaption, .chart, .warning, summary, .protocol li');
  const cut = [...parts].filter((part) => {
    const { left, right } = part.getBoundingClientRect();
    return left < 0 || right > width + 1;
  });
  const tops = ['.panel img', 'table'].map((name) => document.querySelector(name).getBoundingClientRect().top);
  parent.postMessage({
    width: innerWidth, cut: cut.map((part) => part.tagName + ' ' + (part.className || part.textContent)), count: parts.length,
    scrolls: document.documentElement.scrollWidth > width, figureFirst: tops[0] < tops[1],
  }, '*');
});
