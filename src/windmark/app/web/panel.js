// What stands beside the drawing: which field, value or sigma, the colour bar, what is shown, time.

WM.element = (tag, attributes = {}, ...children) => {
  const out = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) out.addEventListener(name.slice(2), value);
    else if (value === true) out.setAttribute(name, '');
    else if (value !== false && value !== null) out.setAttribute(name, value);
  }
  out.append(...children);
  return out;
};

WM.svg = (tag, attributes = {}) => {
  const any = WM.element('template');
  any.innerHTML = '<svg></svg>';
  const out = document.createElementNS(any.content.firstChild.namespaceURI, tag);
  for (const [name, value] of Object.entries(attributes)) out.setAttribute(name, value);
  return out;
};

WM.check = (label, on, changed, title = '') => WM.element('label', { class: 'wm-check', title },
  WM.element('input', { type: 'checkbox', checked: on, onchange: (e) => changed(e.target.checked) }), label);

WM.choice = (label, names, chosen, changed) => {
  const select = WM.element('select', { 'aria-label': label, onchange: (e) => changed(Number(e.target.value)) },
    ...names.map((name, k) => WM.element('option', { value: k, selected: k === chosen }, name)));
  return WM.element('label', { class: 'wm-choice' }, WM.element('span', {}, label), select);
};

WM.button = (text, title, clicked) => WM.element('button', { type: 'button', title, onclick: clicked }, text);

const group = (title, ...children) => WM.element('fieldset', {}, WM.element('legend', {}, title), ...children);

// The colour bar: the colours upright, round ticks, the limits to be changed, back to those of the report.
WM.ColourBar = class {
  constructor(changed) {
    this.changed = changed;
    this.strip = WM.element('div', { class: 'wm-strip' });
    this.scale = WM.element('div', { class: 'wm-scale' });
    this.title = WM.element('div', { class: 'wm-bar-title' });
    const limit = (what) => WM.element('input', { type: 'number', step: 'any', 'aria-label': `${what} end of the colours`,
      title: `${what} end of the colours`, onchange: () => this.typed() });
    [this.low, this.high] = [limit('lower'), limit('upper')];
    this.reset = WM.button('reset', 'the limits as they were', () => this.changed(null));
    this.node = WM.element('div', { class: 'wm-bar' }, this.title,
      WM.element('div', { class: 'wm-bar-body' }, this.strip, this.scale),
      WM.element('div', { class: 'wm-limits' }, this.low, '…', this.high, this.reset));
  }

  typed() {
    const [low, high] = [Number(this.low.value), Number(this.high.value)];
    if (high > low) this.changed([low, high]);
  }

  show(title, palette, [low, high], [least, most]) {
    this.title.textContent = title;
    const stops = [];
    for (let k = 0; k < 256; k += 15) stops.push(`rgb(${palette[4 * k]},${palette[4 * k + 1]},${palette[4 * k + 2]})`);
    this.strip.style.background = `linear-gradient(to top, ${stops.join(',')})`;
    this.strip.classList.toggle('wm-more-above', most > high + 1e-9 * (high - low));
    this.strip.classList.toggle('wm-more-below', least < low - 1e-9 * (high - low));
    const ticks = WM.ticks(low, high);
    const texts = WM.tickTexts(ticks);
    this.scale.replaceChildren(...ticks.map((t, k) => WM.element('span',
      { style: `bottom:${(100 * (t - low)) / (high - low || 1)}%` }, texts[k])));
    this.low.value = WM.digits(low, 4).replace('\u2212', '-');
    this.high.value = WM.digits(high, 4).replace('\u2212', '-');
  }
};

// All controls of a scene. `scene` has the state; every control changes it and asks for a new drawing.
WM.panel = (scene) => {
  const { model, show } = scene;
  const { head } = model;
  const parts = [];
  if (model.fields.length) {
    scene.bar = new WM.ColourBar((limits) => scene.setLimits(limits));
    const which = model.fields.length > 1
      ? WM.choice('field', model.fields.map((f) => f.name), scene.chosen, (k) => scene.choose(k)) : '';
    scene.chooser = which && which.querySelector('select');
    scene.sigmaSwitch = WM.element('div', { class: 'wm-switch', role: 'radiogroup', 'aria-label': 'colours show' },
      ...['value', 'sigma'].map((what) => WM.button(what, `colours show the ${what}`, () => scene.setSigma(what === 'sigma'))));
    parts.push(group('Colours', which, scene.sigmaSwitch, scene.bar.node,
      WM.check('relief', false, (on) => scene.set('relief', on), 'light on the coloured surface too: shape shows, colours get darker')));
  }
  if (head.sequence) parts.push(group('Sequence', ...WM.player(scene)));
  const shown = [];
  const add = (there, key, label, title) => there && shown.push(WM.check(label, show[key], (on) => scene.set(key, on), title));
  add(model.surface, 'surface', 'surface', 'the grid of the model');
  add(model.surface && model.surface.edges.length, 'edges', 'edges', 'borders and sharp edges of the grid');
  add(scene.ghost, 'ghost', 'undeformed edges', 'borders of the grid before it was deformed');
  add(model.cameras.length, 'cameras', 'cameras', 'stations, and what each camera has in view');
  add(head.markers, 'markers', 'markers', 'the markers where the table has them');
  add(head.markers, 'names', 'names', 'names of markers and cameras');
  add(head.markers && head.markers.axes, 'ellipsoids', 'error ellipsoids', head.markers && head.markers.axesWords);
  const residuals = model.fields.some((f) => f.shifted) || (head.sequence && head.sequence.shifts.some(Boolean));
  add(residuals, 'residuals', 'residuals', 'where the markers seem to be in the chosen picture, less where they are');
  add(head.lines.length, 'lines', head.linesAre, head.lines.map((l) => l.name).join(', '));
  parts.push(group('Shown', ...shown));
  if (head.markers && head.markers.groups.length) {
    parts.push(group('Markers in colour', ...head.markers.groups.map((g) => WM.element('div', { class: 'wm-key' },
      WM.element('i', { style: `background:${g.colour}` }), `${g.words} (${g.of.length})`))));
  }
  if (head.markers) {
    scene.scales = WM.element('p', { class: 'wm-words' });
    parts.push(scene.scales);
  }
  if (model.surface && model.surface.volumes.length > 1) {
    parts.push(group('Volumes', ...model.surface.volumes.map((v) => WM.check(v.name, v.on, (on) => {
      v.on = on;
      scene.redraw();
    }))));
  }
  const views = [['home', () => scene.orbit.home()]];
  const looks = [['x', 0], ['y', 1], ['z', 2]];
  for (const [name, axis] of looks) views.push([`along ${name}`, () => scene.along(axis)]);
  parts.push(group('View from', WM.element('div', { class: 'wm-buttons' },
    ...views.map(([name, go]) => WM.button(name, `look ${name}`, () => {
      go();
      scene.redraw();
    })),
    model.cameras.length ? WM.choice('camera', ['…', ...model.cameras.map((c) => c.name)], 0, (k) => {
      if (k > 0 && model.cameras[k - 1]) scene.orbit.from(model.cameras[k - 1]);
      scene.redraw();
    }) : '',
    WM.button('save picture', 'the drawing as a PNG file', () => scene.save()))));
  return parts;
};

// Time: a slider over the frames, a button that runs through them, the magnification.
WM.player = (scene) => {
  const { sequence } = scene.model;
  const last = sequence.labels.length - 1;
  const first = scene.model.frame;
  const label = WM.element('output', { class: 'wm-words' }, sequence.labels[first]);
  const slider = WM.element('input', { type: 'range', min: 0, max: last, value: first, 'aria-label': 'frame' });
  scene.showFrame = (k) => {
    slider.value = k;
    label.textContent = sequence.labels[k];
  };
  const go = (k) => scene.setFrame(k);
  slider.addEventListener('input', () => go(Number(slider.value)));
  let clock = null;
  const play = WM.button('play', 'run through the frames', () => {
    clearInterval(clock);
    clock = clock ? null : setInterval(() => go((Number(slider.value) + 1) % (last + 1)), 120);
    play.textContent = clock ? 'stop' : 'play';
  });
  const moves = new Set(sequence.cameras.filter((of) => of.length).map((of) => String(of[0].center))).size > 1;
  const still = moves ? [WM.check('the camera stands still', false, (on) => { scene.steady = on; },
    'the view goes with the camera, so that the model moves as its pictures show it')] : [];
  const magnify = WM.element('input', { type: 'number', min: 0, step: 'any', value: scene.model.magnify,
    'aria-label': 'magnification of the deformation', onchange: (e) => {
      const times = Number(e.target.value);
      if (times >= 0 && Number.isFinite(times)) scene.setMagnify(times);
    } });
  const what = sequence.field === null ? 'displacement ×' : 'deformation ×';
  const factor = WM.element('label', { class: 'wm-choice' }, WM.element('span', {}, what), magnify);
  return [label, slider, ...still, WM.element('div', { class: 'wm-buttons' }, play, sequence.modes.length ? factor : '')];
};
