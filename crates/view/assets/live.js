const panel = document.querySelector('.panel'), besides = document.querySelector('.beside');
const token = document.querySelector('meta[name="infonerf-token"]').content;
// `#run=0/a&beside=0/b` opens two runs; for tests, `&camera=2&size=64` puts that view's pixels into each stage.
const wanted = new URLSearchParams(location.hash.slice(1));

async function ask(path, query = {}) {
  const answer = await fetch(`${path}?${new URLSearchParams(query)}`);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

/** Frame of the camera: scenes that agree in it are looked at from the same place. */
const place = (scene) => JSON.stringify([scene.centre, scene.up, scene.radius]);

/** Version of a run's field: it changes with each checkpoint, and at the end, when a baked field gets more voxels. */
const version = ({ stamp, state }) => `${stamp} ${state === 'finished'}`;

/** Stage with the run that it shows. */
class Pane {
  constructor(root) {
    Object.assign(this, { root, run: null, shown: null, version: null, scene: null, stage: null });
  }

  /** Shows the newest state of a run. The camera stays in its place if it looks at the same scene. */
  async show(listed) {
    const { run, name } = listed;
    [this.run, this.version] = [run, version(listed)];
    const title = this.root.querySelector('h1');
    title.textContent = name;
    const work = this.showWork(run);
    try {
      this.stage ??= new Stage(this.root);
      const scene = await ask('field', { run });
      if (this.run !== run) return;
      const keepCamera = this.scene !== null && place(this.scene) === place(scene);
      if (!(await this.stage.load(scene, keepCamera))) return;
      title.textContent = name;
      this.scene = scene;
      this.shown = run;
      align();
    } catch (error) {
      if (this.run === run) showFallback(this.root, error, null);
    } finally {
      clearInterval(work);
    }
  }

  /** Shows the work that the server does for a run until its field is there: a timer to be cleared then. */
  showWork(run) {
    if (this.shown === run) return null;
    const message = this.root.querySelector('.message'), start = performance.now();
    const show = (work) => {
      if (this.run !== run || this.shown === run) return;
      message.textContent = `${work || 'Loading'}, ${Math.round((performance.now() - start) / 1000)} s so far`;
      message.hidden = false;
    };
    return setInterval(() => ask('work', { run }).then(show).catch(() => {}), 1000);
  }
}

const [main, beside] = [...document.querySelectorAll('.stage')].map((root) => new Pane(root));
let runs = [], listed = '', state = null;

/** Makes both panes use the main pane's camera. */
function align() {
  if (!main.scene) return;
  const twins = beside.run !== null && beside.scene !== null;
  main.stage.twin = twins ? beside.stage : null;
  if (twins) beside.stage.twin = main.stage;
  if (wanted.has('camera')) main.stage.goTo(Number(wanted.get('camera')));
  else main.stage.moved();
  wanted.delete('camera');
  if (!wanted.has('size')) return;
  for (const { root, stage, scene } of [main, beside]) if (scene) root.dataset.pixels = stage.pixels(Number(wanted.get('size')));
}

async function showProgress(run) {
  const { steps, loss, terms, psnr, views } = await ask('progress', { run });
  if (main.run !== run) return;
  drawCurves(panel.querySelector('.loss'), steps, [['total', loss], ...Object.entries(terms)], symmetricLog);
  drawCurves(panel.querySelector('.psnr'), steps, [['PSNR', psnr]], linear, ' dB');
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

function listRuns() {
  const now = JSON.stringify([runs, main.run, beside.run]);
  if (now === listed) return;
  listed = now;
  const none = Object.assign(document.createElement('small'), { textContent: 'None yet.' });
  document.querySelector('.runs').replaceChildren(...(runs.length > 0 ? [] : [none]), ...runs.map((run) => {
    const button = document.createElement('button'), small = document.createElement('small');
    button.type = 'button';
    button.textContent = run.name;
    button.setAttribute('aria-current', run.run === main.run);
    small.textContent = run.state;
    button.append(small);
    button.addEventListener('click', () => choose(run));
    return button;
  }));
  besides.hidden = runs.length < 2;
  const options = runs.map(({ run, name }) => new Option(name, run, false, run === beside.run));
  besides.querySelector('select').replaceChildren(new Option('nothing', ''), ...options);
}

/** Shows pause and stop where a training runs in the server's process. */
function showTraining(training) {
  const box = document.querySelector('.training');
  box.hidden = training === null;
  if (training === null) return;
  const pause = box.querySelector('.pause');
  pause.textContent = training.paused ? 'Resume' : 'Pause';
  pause.dataset.command = training.paused ? 'resume' : 'pause';
  for (const button of box.querySelectorAll('button')) button.disabled = training.stopped;
  box.querySelector('small').textContent = training.stopped ? 'Stopped and saved; the same command continues it.' : training.paused ? 'Paused.' : '';
}

async function command(name) {
  const answer = await fetch(name, { method: 'POST', headers: { 'x-infonerf-token': token } });
  if (answer.ok) showTraining(await answer.json());
}

function choose(run) {
  showProgress(run.run).catch(() => {});
  main.show(run);
}

/** Shows a second run next to the first; without one, the first alone. */
function compare(run) {
  document.querySelector('.stages').classList.toggle('both', Boolean(run));
  if (run) return beside.show(run);
  Object.assign(beside, { run: null, version: null });
  align();
}

/** The run that opens by itself: one that trains, else the one with the newest checkpoint. */
const first = () => runs.find(({ state }) => state === 'training')
  ?? runs.reduce((newest, run) => (run.stamp > newest.stamp ? run : newest));

/** Requests the list of runs every two seconds while the page is visible. */
async function follow() {
  if (document.hidden) return;
  try {
    const [list, training] = await Promise.all([ask('runs'), ask('training')]);
    runs = list;
    showTraining(training);
    const named = (name) => runs.find(({ run }) => run === name), current = named(main.run);
    if (!current && runs.length > 0 && main.run === null) {
      choose(named(wanted.get('run')) ?? first());
      if (named(wanted.get('beside'))) compare(named(wanted.get('beside')));
    }
    listRuns();
    for (const pane of [main, beside]) {
      const run = named(pane.run);
      if (run && version(run) !== pane.version) pane.show(run);
    }
    if (current && (current.state !== state || current.state === 'training')) showProgress(current.run).catch(() => {});
    state = current?.state;
  } catch {
    // The server is gone, or busy: it is asked again.
  }
}

panel.querySelector('select').addEventListener('change', () => showView(main.run));
panel.querySelector('input').addEventListener('input', (event) =>
  panel.querySelector('.compare').style.setProperty('--at', `${event.target.value}%`));
besides.querySelector('select').addEventListener('change', (event) => compare(runs.find(({ run }) => run === event.target.value)));
for (const button of document.querySelectorAll('.training button'))
  button.addEventListener('click', () => command(button.dataset.command ?? 'stop').catch(() => {}));
setInterval(follow, 2000);
document.addEventListener('visibilitychange', follow);
follow();
