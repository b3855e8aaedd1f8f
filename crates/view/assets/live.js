const root = document.querySelector('.stage'), panel = document.querySelector('.panel');
const shown = { run: null, version: null, scene: null, listed: '' };
let stage = null;

async function ask(path, query = {}) {
  const answer = await fetch(`${path}?${new URLSearchParams(query)}`);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

/** What the camera depends on: scenes that agree in it are looked at from the same place. */
const place = (scene) => JSON.stringify([scene.centre, scene.up, scene.radius]);

/** Which state of a run is looked at: a field that is baked is so more finely once it is finished. */
const version = ({ stamp, state }) => `${stamp} ${state === 'finished'}`;

async function showField(run, version) {
  const keep = shown.scene;
  [shown.run, shown.version] = [run, version];
  root.querySelector('h1').textContent = run;
  try {
    stage ??= new Stage(root);
    const scene = await ask('field', { run });
    if (shown.run !== run) return;
    await stage.load(scene, keep !== null && place(keep) === place(scene));
    shown.scene = scene;
  } catch (error) {
    if (shown.run === run) showFallback(root, error, null);
  }
}

/** A curve between its least and greatest number, the logarithm of it if asked for. */
function curve(name, points, index, logarithmic, unit) {
  const values = points.filter((point) => point[index] !== null && (!logarithmic || point[index] > 0));
  const of = (point) => (logarithmic ? Math.log(point[index]) : point[index]);
  const low = Math.min(...values.map(of)), high = Math.max(...values.map(of)), last = values.at(-1);
  const x = (point) => (100 * point[0]) / (last[0] || 1), y = (point) => 97 - (94 * (of(point) - low)) / (high - low || 1);
  panel.querySelector(`svg.${name} polyline`).setAttribute('points', values.map((point) => `${x(point)},${y(point)}`).join(' '));
  const title = panel.querySelector(`h2.${name}`);
  title.dataset.title ??= title.textContent;
  title.textContent = last ? `${title.dataset.title}: ${last[index].toPrecision(4)}${unit} at step ${last[0]}` : title.dataset.title;
}

async function showProgress(run) {
  const { points, views } = await ask('progress', { run });
  if (shown.run !== run) return;
  curve('loss', points, 1, true, '');
  curve('psnr', points, 2, false, ' dB');
  const select = panel.querySelector('select'), before = select.value;
  panel.querySelector('.views').hidden = views.length === 0;
  select.replaceChildren(...views.map((name) => new Option(`view ${name}`, name, false, name === before)));
  showView(run);
}

function showView(run) {
  const name = panel.querySelector('select').value;
  if (!name) return;
  for (const [selector, kind] of [['.render', 'test'], ['.truth', 'truth']])
    panel.querySelector(selector).src = `picture?${new URLSearchParams({ run, kind, name })}`;
}

function listRuns(runs) {
  const listed = JSON.stringify([runs, shown.run]);
  if (listed === shown.listed) return;
  shown.listed = listed;
  const none = Object.assign(document.createElement('small'), { textContent: 'None yet.' });
  document.querySelector('.runs').replaceChildren(...(runs.length > 0 ? [] : [none]), ...runs.map((listed) => {
    const { run, name, state } = listed;
    const button = document.createElement('button'), small = document.createElement('small');
    button.type = 'button';
    button.textContent = name;
    button.setAttribute('aria-current', run === shown.run);
    small.textContent = state;
    button.append(small);
    button.addEventListener('click', () => choose(run, version(listed)));
    return button;
  }));
}

/** Pause and stop, where training goes on beside the server. */
function showTraining(training) {
  const box = document.querySelector('.training');
  box.hidden = training === null;
  if (training === null) return;
  const pause = box.querySelector('.pause');
  pause.textContent = training.paused ? 'Go on' : 'Pause';
  pause.dataset.command = training.paused ? 'resume' : 'pause';
  for (const button of box.querySelectorAll('button')) button.disabled = training.stopped;
  box.querySelector('small').textContent = training.stopped ? 'Stopped and saved; --resume goes on.' : training.paused ? 'Paused.' : '';
}

async function command(name) {
  const answer = await fetch(name, { method: 'POST', headers: { 'x-infonerf': 'page' } });
  if (answer.ok) showTraining(await answer.json());
}

function choose(run, version) {
  showField(run, version);
  showProgress(run).catch(() => {});
  follow();
}

/** Asks what is new every two seconds while somebody looks. */
async function follow() {
  if (document.hidden) return;
  try {
    const [runs, training] = await Promise.all([ask('runs'), ask('training')]);
    showTraining(training);
    const current = runs.find(({ run }) => run === shown.run);
    listRuns(runs);
    if (!current && runs.length > 0 && shown.run === null) return choose(runs[0].run, version(runs[0]));
    if (current && version(current) !== shown.version) showField(current.run, version(current));
    if (current && (current.state !== shown.state || current.state === 'training')) showProgress(current.run).catch(() => {});
    shown.state = current?.state;
  } catch {
    // The server is gone, or busy: it is asked again.
  }
}

panel.querySelector('select').addEventListener('change', () => showView(shown.run));
panel.querySelector('input').addEventListener('input', (event) =>
  panel.querySelector('.compare').style.setProperty('--at', `${event.target.value}%`));
for (const button of document.querySelectorAll('.training button'))
  button.addEventListener('click', () => command(button.dataset.command ?? 'stop').catch(() => {}));
setInterval(follow, 2000);
document.addEventListener('visibilitychange', follow);
follow();
