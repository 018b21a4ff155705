// The viewer: talks to its server, shows what the project file says of the spots, and writes what is clicked.

const WM = window.WM;
const data = JSON.parse(document.getElementById('wm-view-data').textContent);
const token = new URLSearchParams(location.search).get('token') || '';
const told = { images: {} };

const request = async (path, body) => {
  const headers = { 'X-Windmark-Token': token };
  if (body) headers['Content-Type'] = 'application/json';
  let answer;
  try {
    answer = await fetch(path, body
      ? { method: 'POST', headers, body: JSON.stringify({ run: data.run, ...body }) } : { headers });
  } catch {
    throw new Error('the viewer has ended; start windmark view again');
  }
  if (!answer.ok) throw new Error((await answer.json()).error);
  return answer;
};
const ask = async (path, body) => (await request(path, body)).json();

const bar = document.querySelector('.wm-bar-top');
const status = bar.querySelector('.wm-status');
const runButton = bar.querySelector('.wm-run');
let timer = null;

const say = (words, bad) => {
  status.textContent = words;
  status.classList.toggle('bad', Boolean(bad));
};

// A state of the server on the page; while a job is at work it is asked for again.
const show = (state) => {
  Object.assign(told, state);
  runButton.disabled = state.busy;
  const edits = state.edits.map((words) => WM.element('li', {}));
  edits.forEach((item, k) => { item.textContent = state.edits[k]; });
  bar.querySelector('.wm-edits').replaceChildren(...edits);
  bar.classList.toggle('wm-pending', state.edits.length > 0 && !state.busy);
  if (state.busy) say(`at work: ${state.stage} …`);
  else if (state.problem) say(state.problem, true);
  else if (state.unread) say(state.unread, true);
  else if (state.edits.length) say('written into the project; run again to see what it changes');
  else say(data.run ? '' : 'nothing to show');
  document.querySelectorAll('.wm-view').forEach(mark);
  clearTimeout(timer);
  if (state.busy) timer = setTimeout(look, 600);
  else if (state.run !== data.run) location.reload();
  document.documentElement.dataset.view = state.busy ? 'busy' : `run ${data.run}`;
};
const look = async () => {
  try {
    show(await ask('/state'));
  } catch (error) {
    say(error.message, true);
  }
};
runButton.addEventListener('click', async () => {
  try {
    show(await ask('/run', {}));
  } catch (error) {
    say(error.message, true);
  }
});

const NS = 'http://www.w3.org/2000/svg';
const svg = (kind, set, title) => {
  const made = document.createElementNS(NS, kind);
  for (const [key, value] of Object.entries(set)) made.setAttribute(key, value);
  if (title) made.appendChild(document.createElementNS(NS, 'title')).textContent = title;
  return made;
};

// What the project file says of the spots of a picture: named ones and those that take no part.
const mark = (view) => {
  const drawing = view.querySelector('.wm-zoom svg');
  const image = told.images[view.dataset.image];
  if (!drawing || !image) return;
  const circles = drawing.querySelectorAll('circle[data-spot]');
  const excluded = new Set(image.excluded);
  const named = new Map(Object.entries(image.labels).map(([name, spot]) => [spot, name]));
  circles.forEach((circle, k) => {
    circle.classList.toggle('told', named.has(k));
    circle.classList.toggle('excluded', excluded.has(k));
  });
  drawing.querySelectorAll('.of-told').forEach((old) => old.remove());
  const { size, names } = data.images[view.dataset.image];
  const step = size[0] / 110;
  for (const [spot, name] of named) {
    if (spot === null || names[spot] === name) continue; // the run's own name is there
    const circle = circles[spot];
    const text = svg('text', { class: 'of-told', x: Number(circle.getAttribute('cx')) + step, y: Number(circle.getAttribute('cy')) + 1.7 * step });
    text.textContent = name;
    drawing.append(text);
  }
};

const NAMED = '<i style="border-color: #40a9ff"></i>named in the project';
const OUT = '<i style="border-color: #e0457b; border-style: dashed"></i>excluded in the project';

// Candidates that detection rejected: asked for when somebody wants to see them.
const explain = (view, figure) => {
  const label = WM.element('label', {});
  label.innerHTML = '<input type="checkbox" class="wm-explain"> <i style="border-color: #b388ff; border-style: dashed"></i>'
    + '<span>rejected candidates</span>';
  const [box, words] = [label.querySelector('input'), label.querySelector('span')];
  let group = null;
  box.addEventListener('change', async () => {
    if (group) {
      group.style.display = box.checked ? '' : 'none';
      return;
    }
    if (!box.checked) return;
    words.textContent = 'looking …';
    try {
      const { rejected } = await ask('/explain', { image: view.dataset.image });
      group = svg('g', { class: 'rejected' });
      for (const [x, y, radius, merit, reason] of rejected) {
        const r = Math.max(1.4 * (radius || 3), 4);
        const note = `${reason}; x ${x.toFixed(2)}, y ${y.toFixed(2)} px` + (merit === null ? '' : `, merit ${merit.toFixed(3)}`);
        group.append(svg('circle', { cx: x, cy: y, r }, note));
      }
      figure.querySelector('.wm-zoom svg').prepend(group); // below the spots, which can be clicked
      words.textContent = `rejected candidates (${rejected.length})`;
    } catch (error) {
      words.textContent = error.message;
      box.checked = false;
    }
  });
  return label;
};

// The line of sight of one spot in the other pictures; that of the spot before goes.
let sight = { lines: {}, words: '' };
const drawSight = (lines, words) => {
  sight = { lines, words };
  document.querySelectorAll('.wm-view').forEach(putSight);
};
const putSight = (view) => {
  const drawing = view.querySelector('.wm-zoom svg');
  if (!drawing) return;
  drawing.querySelectorAll('.sight').forEach((old) => old.remove());
  const line = sight.lines[view.dataset.image];
  if (line) drawing.prepend(svg('path', { class: 'sight', d: `M${line.map((p) => p.join(' ')).join('L')}` }, sight.words));
};

let pop = null;
const closePop = () => {
  const chosen = document.querySelector('circle.chosen');
  const held = pop && pop.contains(document.activeElement);
  if (pop) pop.remove();
  if (held && chosen) chosen.focus({ preventScroll: true }); // the keyboard goes on from there
  document.querySelectorAll('circle.chosen').forEach((c) => c.classList.remove('chosen'));
  pop = null;
};

// The choice at a spot: name it, take it out, or take back what the project says of it.
const openPop = (circle, x, y) => {
  closePop();
  const view = circle.closest('.wm-view');
  const [image, spot] = [view.dataset.image, Number(circle.dataset.spot)];
  const own = told.images[image] || { labels: {}, excluded: [] };
  const label = Object.keys(own.labels).find((name) => own.labels[name] === spot);
  const out = own.excluded.includes(spot);
  pop = WM.element('div', { class: 'wm-pop', role: 'dialog', 'aria-label': `spot ${spot} of ${image}` });
  pop.innerHTML = '<button type="button" class="wm-close-pop" aria-label="close">×</button><p class="wm-what"></p>'
    + '<p class="soft wm-says"></p><form><input list="wm-markers" autocomplete="off" placeholder="marker" aria-label="marker">'
    + '<button>name it</button></form><div class="wm-buttons"><button type="button" class="wm-exclude">exclude it</button>'
    + '<button type="button" class="wm-free">free it again</button>'
    + '<button type="button" class="wm-sight">its line of sight in the other pictures</button></div><p class="bad"></p>';
  const find = (what) => pop.querySelector(what);
  find('.wm-what').textContent = circle.querySelector('title').textContent;
  find('.wm-says').textContent = label ? `The project names it ${label}.` : out ? 'The project excludes it.'
    : 'The project says nothing of it.';
  find('input').value = label || data.images[image].names[spot] || '';
  find('.wm-exclude').disabled = out;
  find('.wm-free').disabled = !label && !out;
  find('.wm-sight').hidden = !data.images[image].posed || Object.values(data.images).filter((i) => i.posed).length < 2;
  const send = async (path, more) => {
    try {
      const state = await ask(path, { image, spot, ...more });
      closePop();
      show(state);
    } catch (error) {
      if (pop) find('.bad').textContent = error.message;
    }
  };
  find('form').addEventListener('submit', (e) => {
    e.preventDefault();
    send('/name', { marker: find('input').value.trim() });
  });
  find('.wm-exclude').addEventListener('click', () => send('/exclude'));
  find('.wm-free').addEventListener('click', () => send('/free'));
  find('.wm-sight').addEventListener('click', async () => {
    try {
      const { lines } = await ask('/sight', { image, spot });
      drawSight(lines, `line of sight of spot ${spot} of ${image}`);
      const seen = Object.keys(lines);
      if (pop) find('.wm-says').textContent = seen.length ? `Its line of sight is drawn in ${seen.length > 4 ? `${seen.length} other pictures` : seen.join(', ')}.` : 'No other picture sees its line of sight.';
    } catch (error) {
      if (pop) find('.bad').textContent = error.message;
    }
  });
  find('.wm-close-pop').addEventListener('click', closePop);
  circle.classList.add('chosen');
  document.body.append(pop);
  const width = document.documentElement.clientWidth;
  pop.style.left = `${Math.max(Math.min(x + 14, width - pop.offsetWidth - 8), 8) + scrollX}px`;
  pop.style.top = `${y + 14 + scrollY}px`;
  find('input').focus({ preventScroll: true });
  find('input').select();
};

// A picture that is dragged holds the pointer, so what was under it is remembered when it went down. What is drawn over a
// spot (where a marker was expected, a line of sight) does not keep the click from it.
let pressed = null;
document.addEventListener('pointerdown', (e) => {
  if (pop && !pop.contains(e.target)) closePop();
  const inPop = pop && pop.contains(e.target);
  const circle = inPop ? null
    : document.elementsFromPoint(e.clientX, e.clientY).find((one) => one.matches('circle[data-spot]'));
  pressed = circle ? { circle, x: e.clientX, y: e.clientY } : null;
}, true);
document.addEventListener('pointerup', (e) => {
  if (pressed && Math.hypot(e.clientX - pressed.x, e.clientY - pressed.y) < 4) openPop(pressed.circle, e.clientX, e.clientY);
  pressed = null;
}, true);
document.addEventListener('keydown', (e) => { if (e.key === 'Escape') closePop(); });

// Spots by keyboard: arrows go to the next one in that direction, of those that the zoom leaves in sight; Enter opens it.
const STEPS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1] };
const middle = (one) => {
  const box = one.getBoundingClientRect();
  return [box.left + box.width / 2, box.top + box.height / 2];
};
const byKeys = (figure) => {
  const circles = [...figure.querySelectorAll('circle[data-spot]')];
  const frame = figure.querySelector('.wm-zoom');
  if (!circles.length || !frame) return;
  for (const circle of circles) {
    circle.setAttribute('tabindex', '-1');
    circle.setAttribute('role', 'button');
    circle.setAttribute('aria-label', circle.querySelector('title').textContent);
  }
  const next = (from, [dx, dy]) => {
    const { left, right, top, bottom } = frame.getBoundingClientRect();
    const [x, y] = from ? middle(from) : [left, top];
    let [best, least] = [null, Infinity];
    for (const circle of circles) {
      const [u, v] = middle(circle);
      if (circle === from || u < left || u > right || v < top || v > bottom) continue;
      const along = (u - x) * dx + (v - y) * dy;
      const across = Math.abs((u - x) * dy) + Math.abs((v - y) * dx);
      const far = from ? along + 2 * across : Math.hypot(u - x, v - y);
      if ((!from || (along > 0 && across <= 2 * along)) && far < least) [best, least] = [circle, far];
    }
    return best;
  };
  frame.addEventListener('keydown', (e) => {
    const here = circles.includes(document.activeElement) ? document.activeElement : null;
    if (STEPS[e.key]) {
      e.preventDefault();
      const to = next(here, STEPS[e.key]);
      if (to) to.focus({ preventScroll: true });
    } else if (here && (e.key === 'Enter' || e.key === ' ')) {
      e.preventDefault();
      openPop(here, ...middle(here));
    }
  });
};

const liven = WM.liven;
WM.liven = (root) => {
  liven(root);
  root.querySelectorAll('.wm-view').forEach((view) => {
    const figure = view.querySelector('.wm-photo');
    if (!figure || figure.dataset.live) return;
    figure.dataset.live = 'yes';
    figure.querySelectorAll('.spots circle').forEach((circle, k) => { circle.dataset.spot = k; });
    const row = figure.querySelector('.wm-layers');
    if (data.images[view.dataset.image].look) row.append(explain(view, figure));
    for (const words of figure.querySelector('circle[data-spot]') ? [NAMED, OUT] : []) {
      const key = WM.element('span', {});
      key.innerHTML = words;
      row.append(key);
    }
    byKeys(figure);
    pointOfView(view, figure);
    mark(view);
    putSight(view);
  });
};

const list = WM.element('datalist', { id: 'wm-markers' });
for (const name of data.markers) list.append(WM.element('option', { value: name }));
document.body.append(list);
document.addEventListener('DOMContentLoaded', look);
