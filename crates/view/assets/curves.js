const CHART = { width: 280, height: 150, left: 44, right: 6, top: 8, bottom: 18 };
/** Number of decades of a symmetric-logarithmic axis below the greatest value; within the last one it is linear. */
const DECADES = 3;

/** Makes an axis that is linear about 0 and logarithmic beyond `unit`, on either side. */
function symmetricLog(low, high) {
  const power = Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high), 1e-12))), ticks = [0];
  for (let k = power; k > power - DECADES; k--) ticks.push(10 ** k, -(10 ** k));
  const unit = 10 ** (power - DECADES + 1);
  return { of: (value) => Math.sign(value) * Math.log10(1 + Math.abs(value) / unit), ticks };
}

/** Makes a linear axis with about four ticks. */
function linear(low, high) {
  const rough = (high - low) / 4 || 1, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((times) => times * power >= rough), ticks = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) ticks.push(i * step);
  return { of: (value) => value, ticks };
}

const shortNumber = (value) => {
  const size = Math.abs(value);
  return size === 0 || (size >= 0.01 && size < 1e4) ? String(+value.toPrecision(4)) : value.toExponential().replace('e+', 'e');
};

/** Draws `curves`, a list of names and values by step, into a figure: lines, ticks, and a legend with each one's last value. */
function drawCurves(figure, steps, curves, axisOf, suffix = '') {
  const finite = curves.flatMap(([, values]) => values.filter((value) => value !== null));
  figure.hidden = finite.length === 0;
  if (figure.hidden) return;
  const low = Math.min(...finite), high = Math.max(...finite), axis = axisOf(low, high);
  const { width, height, left, right, top, bottom } = CHART, [from, to] = [axis.of(low), axis.of(high)];
  const x = (step) => left + ((width - left - right) * step) / (steps.at(-1) || 1);
  const y = (value) => height - bottom - ((height - top - bottom) * (axis.of(value) - from)) / (to - from || 1);
  const make = (name, attributes, text) => {
    const element = document.createElementNS(figure.querySelector('svg').namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return element;
  };
  const shown = axis.ticks.filter((tick) => tick >= low && tick <= high);
  const marks = [low, high].filter((end) => shown.every((tick) => Math.abs(y(tick) - y(end)) > 10)).concat(shown);
  const ticks = marks.flatMap((tick) => [
    make('line', { x1: left, x2: width - right, y1: y(tick), y2: y(tick) }),
    make('text', { x: left - 4, y: y(tick) + 3, 'text-anchor': 'end' }, shortNumber(tick)),
  ]);
  const color = (i) => (i === 0 ? 'var(--accent)' : `hsl(${(207 + 137.5 * i) % 360} 65% 50%)`);
  const lines = curves.map(([name, values], i) => {
    let path = '', gap = true;
    values.forEach((value, k) => {
      if (value !== null) path += `${gap ? 'M' : 'L'}${x(steps[k]).toFixed(2)} ${y(value).toFixed(2)}`;
      gap = value === null;
    });
    return make('path', { d: path, 'data-name': name, style: `stroke: ${color(i)}` });
  });
  const ends = [['start', left, '0'], ['end', width - right, `step ${steps.at(-1)}`]];
  const words = ends.map(([anchor, at, text]) => make('text', { x: at, y: height - 4, 'text-anchor': anchor }, text));
  const svg = make('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img' });
  svg.append(...ticks, ...words, ...lines.reverse());
  const legend = document.createElement('figcaption');
  legend.append(...curves.map(([name, values], i) => {
    const entry = document.createElement('span'), last = values.findLast((value) => value !== null);
    entry.style.setProperty('--color', color(i));
    entry.textContent = `${name} ${last === undefined ? '–' : shortNumber(+last.toPrecision(4))}${suffix}`;
    return entry;
  }));
  figure.replaceChildren(svg, legend);
}
