// One scene of a page: state, drawing, what is said under the cursor.

const NAMED = 30; // with more markers names are in each other's way

WM.Scene = class {
  constructor(node, model) {
    this.node = node;
    this.model = model;
    this.canvas = node.querySelector('canvas');
    this.names = node.querySelector('.wm-names');
    this.tip = node.querySelector('.wm-tip');
    this.gpu = new WM.Gpu(this.canvas);
    this.axes = this.names.parentNode.appendChild(WM.svg('svg', { class: 'wm-axes', viewBox: '-32 -32 64 64' }));
    this.orbit = new WM.Orbit(model);
    const { head } = model;
    const few = head.markers ? head.markers.names.length <= NAMED : false;
    this.show = { surface: true, edges: true, ghost: true, cameras: true, markers: true, names: few, ellipsoids: true,
      residuals: true, lines: true, relief: false };
    this.chosen = head.chosen || 0;
    this.sigma = false;
    this.limits = new Map();
    this.prepare();
    node.querySelector('.wm-panel').replaceChildren(...WM.panel(this));
    this.say();
    WM.hands(this.canvas, this.orbit, () => this.redraw());
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.redraw());
  }

  static async make(node) {
    const scene = new WM.Scene(node, new WM.Model(await WM.blob(node.dataset.blob)));
    if (scene.model.fields.length) await scene.choose(scene.chosen);
    else scene.shift(scene.shiftsNow());
    scene.draw();
    return scene;
  }

  prepare() {
    const { model, gpu } = this;
    const { head, surface } = model;
    if (surface) {
      gpu.setSurface(surface);
      if (head.sequence && head.sequence.field !== null) this.ghost = gpu.points(Array.from(surface.edges).flatMap((k) => [...surface.rest.subarray(3 * k, 3 * k + 3)]));
    }
    this.prepareCameras();
    this.linesGpu = head.lines.map((l) => ({ ...l, points: gpu.points(l.pairs) }));
    this.prepareMarkers();
  }

  prepareCameras() {
    const { cameras } = this.model;
    this.frustums = cameras.map((c) => this.gpu.points(WM.frustumLines(c)));
    this.stations = cameras.map((c) => c.center);
  }

  prepareMarkers() {
    const { model, gpu } = this;
    const { markers } = model.head;
    if (!markers) return;
    const grouped = new Set(markers.groups.flatMap((g) => g.of));
    const dots = (which) => gpu.points(which.flatMap((k) => model.spots[k]));
    this.dots = [{ colour: null, points: dots([...model.spots.keys()].filter((k) => !grouped.has(k))) },
      ...markers.groups.map((g) => ({ colour: g.colour, points: dots(g.of) }))];
    if (markers.axes) {
      const { factor } = markers;
      this.balls = gpu.points(model.spots.flatMap((p, k) => [...p, ...markers.axes[k].map((v) => factor * v)]));
    }
  }

  // Residual vectors of the chosen picture at the markers.
  shift(shifts) {
    const { markers } = this.model.head;
    this.shifts = null;
    this.shiftsSaid = markers && shifts ? shifts : null;
    if (this.shiftsSaid) {
      this.shifts = this.gpu.points(this.model.spots.flatMap((p, k) => {
        const vector = shifts.vectors[markers.index[k]];
        return vector ? [...p, ...WM.add(p, vector, shifts.factor)] : [];
      }));
    }
    this.say();
  }

  // Words on what is drawn larger than it is.
  say() {
    const { markers } = this.model.head;
    if (!markers || !this.scales) return;
    const words = [];
    if (markers.axes && this.show.ellipsoids) words.push(markers.axesWords);
    if (this.shiftsSaid && this.show.residuals) words.push(this.shiftsSaid.words);
    this.scales.textContent = words.join(' ');
  }

  set(key, on) {
    this.show[key] = on;
    this.say();
    this.redraw();
  }

  async choose(k) {
    this.chosen = k;
    if (this.chooser) this.chooser.value = k;
    const field = await this.model.field(k);
    if (k !== this.chosen) return;
    if (!field.sigmas) this.sigma = false;
    const { model } = this;
    if (Number.isInteger(field.frame) && model.sequence && field.frame !== model.frame) this.goTo(field.frame);
    this.shift(this.shiftsNow());
    this.colour();
  }

  // Residuals of the frame, or of the chosen field.
  shiftsNow() {
    const { sequence, frame } = this.model;
    const own = this.field && this.field.shifts;
    return own || (sequence && sequence.shifts.length ? sequence.shifts[frame] : null);
  }

  setSigma(on) {
    this.sigma = on && Boolean(this.field && this.field.sigmas);
    this.colour();
  }

  get field() {
    return this.model.fields[this.chosen];
  }

  setLimits(limits) {
    const key = `${this.chosen} ${this.sigma}`;
    if (limits) this.limits.set(key, limits);
    else this.limits.delete(key);
    this.colour();
  }

  // Values or sigmas of the chosen field to the graphics card and the colour bar.
  colour() {
    const { field, sigma } = this;
    const values = sigma ? field.sigmas : field.values;
    const given = sigma ? field.sigmaLimits : field.limits;
    this.range = this.limits.get(`${this.chosen} ${sigma}`) || given;
    this.palette = WM.palette(sigma ? field.sigmaColours : field.colours);
    this.gpu.setPalette(this.palette);
    // Single precision has seven digits: values go to the card less their lower limit.
    this.gpu.setValues(values, this.range[0]);
    let [least, most] = [Infinity, -Infinity];
    for (const v of values) {
      if (v < least) least = v;
      if (v > most) most = v;
    }
    this.bar.show(sigma ? `1 sigma of ${field.label}` : field.label, this.palette, this.range, [least, most]);
    const [first, second] = this.sigmaSwitch.children;
    first.setAttribute('aria-pressed', String(!sigma));
    second.setAttribute('aria-pressed', String(sigma));
    second.disabled = !field.sigmas;
    second.title = field.sigmas ? 'colours show the sigma' : 'this field has no sigma';
    this.redraw();
  }

  // Another frame; a field of the frame before gives way to that of this one.
  setFrame(k) {
    const { field } = this;
    this.goTo(k);
    if (!field || !Number.isInteger(field.frame)) return;
    const same = this.model.fields.findIndex((f) => f.frame === k && f.label === field.label);
    if (same >= 0) this.choose(same);
  }

  goTo(k) {
    const { model } = this;
    const [camera] = model.sequence.cameras.length ? model.sequence.cameras[model.frame] : [];
    this.lastCamera = camera || this.lastCamera;
    model.frame = k;
    const [next] = model.sequence.cameras.length ? model.sequence.cameras[k] : [];
    if (this.steady && next && this.lastCamera) this.orbit.carry(this.lastCamera, next);
    if (this.showFrame) this.showFrame(k);
    this.moved();
  }

  setMagnify(times) {
    this.model.magnify = times;
    this.moved();
  }

  moved() {
    this.model.place();
    if (this.model.surface) this.gpu.setSurface(this.model.surface);
    this.prepareCameras();
    this.prepareMarkers();
    this.shift(this.shiftsNow());
    if (this.chosen === this.model.sequence.field) this.colour();
    this.redraw();
  }

  along(axis) {
    const ahead = [0, 0, 0];
    ahead[axis] = axis === 2 ? -1 : 1;
    this.orbit.home();
    this.orbit.look(ahead, axis === 2 ? [0, 1, 0] : [0, 0, 1]);
  }

  redraw() {
    this.screen = null;
    this.hush(); // what is under the cursor is another thing now
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  draw() {
    const { canvas, gpu, show, model } = this;
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const style = getComputedStyle(canvas);
    const ink = (name) => [...WM.hex(style.getPropertyValue(name).trim()), 1];
    const { view, matrix } = this.orbit.matrices(width / height);
    this.matrix = matrix;
    gpu.begin(canvas.width, canvas.height, ink('--stage').slice(0, 3));
    const { surface, head } = model;
    if (surface && show.surface) {
      gpu.drawSurface(surface.volumes, { matrix, view, range: [0, this.range ? this.range[1] - this.range[0] : 1],
        bare: ink('--bare').slice(0, 3), relief: show.relief ? 1 : 0, coloured: Boolean(this.range) });
    }
    if (surface && show.edges) gpu.drawEdges(matrix, ink('--edge'));
    if (this.ghost && show.ghost) gpu.drawLines(this.ghost, matrix, ink('--ghost'));
    if (show.lines) for (const l of this.linesGpu) gpu.drawLines(l.points, matrix, [...WM.hex(l.colour), 1], 1e-4);
    if (show.cameras) model.cameras.forEach((c, k) => gpu.drawLines(this.frustums[k], matrix, [...WM.hex(c.colour), 1]));
    if (head.markers && show.markers) {
      for (const { colour, points } of this.dots) {
        if (points.count) gpu.drawDots(points, matrix, colour ? [...WM.hex(colour), 1] : ink('--marker'), (colour ? 9 : 7) * scale);
      }
    }
    if (this.shifts && show.residuals) gpu.drawLines(this.shifts, matrix, ink('--shift'), 1e-3);
    if (this.balls && show.ellipsoids) gpu.drawBalls(this.balls, matrix, view, [...ink('--ellipsoid').slice(0, 3), 0.45]);
    this.label(width, height);
    this.drawAxes();
  }

  // The directions of the frame in the corner: what is nearer lies above.
  drawAxes() {
    const { right, up, ahead } = this.orbit;
    const ends = [0, 1, 2].map((a) => ({ name: 'xyz'[a], x: 20 * right[a], y: -20 * up[a], far: ahead[a] }));
    ends.sort((a, b) => b.far - a.far);
    this.axes.replaceChildren(...ends.flatMap(({ name, x, y }) => {
      const line = WM.svg('line', { x2: x, y2: y, class: `wm-axis-${name}` });
      if (Math.hypot(x, y) < 9) return [line]; // it points to or from the reader: its name would lie on another one
      const text = WM.svg('text', { x: 1.35 * x, y: 1.35 * y + 3.5 });
      text.textContent = name;
      return [line, text];
    }));
  }

  // Names beside markers and cameras; one that would lie on another is left out.
  label(width, height) {
    const { head } = this.model;
    const taken = [];
    const out = [];
    const put = (p, name, kind) => {
      const at = WM.onScreen(this.matrix, p, width, height);
      if (!at || at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height) return;
      const wide = 2 + 7 * name.length;
      const left = at[0] + 6 + wide > width ? at[0] - 6 - wide : at[0] + 6;
      const box = [left, at[1] - 14, left + wide, at[1]];
      if (taken.some((b) => b[0] < box[2] && box[0] < b[2] && b[1] < box[3] && box[1] < b[3])) return;
      taken.push(box);
      out.push(WM.element('span', { class: kind, style: `left:${box[0]}px;top:${box[1]}px` }, name));
    };
    if (this.show.names) {
      if (this.show.cameras) this.model.cameras.forEach((c) => put(c.center, c.name, 'wm-camera-name'));
      if (head.markers && this.show.markers) head.markers.names.forEach((n, k) => put(this.model.spots[k], n, 'wm-marker-name'));
    }
    this.names.replaceChildren(...out);
  }

  hush() {
    clearTimeout(this.telling);
    this.tip.hidden = true;
  }

  listen() {
    // A graphics card that was taken away (sleep, too many pages) comes back empty.
    this.canvas.addEventListener('webglcontextlost', (e) => e.preventDefault());
    this.canvas.addEventListener('webglcontextrestored', () => {
      this.gpu = new WM.Gpu(this.canvas);
      this.prepare();
      this.shift(this.shiftsNow());
      if (this.field) this.colour();
      this.redraw();
    });
    this.canvas.addEventListener('pointermove', (e) => {
      this.hush();
      if (e.buttons) return;
      const { left, top } = this.canvas.getBoundingClientRect();
      const [x, y] = [e.clientX - left, e.clientY - top];
      this.telling = setTimeout(() => this.tell(x, y), 60);
    });
    this.canvas.addEventListener('pointerleave', () => this.hush());
  }

  // What is under the cursor, in words.
  tell(x, y) {
    const lines = this.under(x, y);
    this.tip.hidden = !lines.length;
    this.tip.replaceChildren(...lines.map((text, k) => WM.element(k ? 'div' : 'b', {}, text)));
    const left = x > 0.6 * this.canvas.clientWidth;
    this.tip.style.left = left ? '' : `${x + 14}px`;
    this.tip.style.right = left ? `${this.canvas.clientWidth - x + 14}px` : '';
    this.tip.style.top = `${Math.max(y - 10, 0)}px`;
  }

  under(x, y) {
    const { model, show, canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const { head, surface } = model;
    this.matrix = this.orbit.matrices(width / height).matrix;
    if (surface && !this.screen) this.screen = WM.projectNodes(surface, this.matrix, width, height);
    const hit = surface && show.surface ? WM.pickSurface(surface, this.screen, x, y) : null;
    const depth = hit ? hit.depth + 0.02 * model.radius : Infinity;
    const point = (points) => WM.pickPoint(points, this.matrix, width, height, x, y, depth);
    const m = head.markers && show.markers ? point(model.spots) : -1;
    if (m >= 0) {
      const seen = this.shiftsSaid ? this.shiftsSaid.notes[head.markers.index[m]] : '';
      return [head.markers.names[m], ...head.markers.notes[m], ...(seen ? [seen] : [])];
    }
    const c = show.cameras ? point(this.stations) : -1;
    if (c >= 0) return [model.cameras[c].name, ...model.cameras[c].notes];
    if (!hit) return [];
    const decimals = Math.min(Math.max(Math.floor(-Math.log10(surface.step)), 0), 9);
    const place = [0, 1, 2].map((a) => surface.xyz[3 * hit.node + a].toFixed(decimals).replace('-', '\u2212'));
    const out = [`node ${hit.node}${hit.volume ? `, ${hit.volume}` : ''}`, `x, y, z: ${place.join(', ')} ${head.unit}`];
    const { field } = this;
    if (field && field.values) {
      const sigma = field.sigmas ? field.sigmas[hit.node] : undefined;
      out.splice(1, 0, `${field.label}: ${WM.withSigma(field.values[hit.node], sigma, field.digits)}`);
    }
    return out;
  }

  // The drawing with its names, as a picture.
  still() {
    this.draw();
    const { canvas } = this;
    const out = WM.element('canvas', { width: canvas.width, height: canvas.height });
    const pen = out.getContext('2d');
    pen.drawImage(canvas, 0, 0);
    const scale = canvas.width / canvas.clientWidth;
    pen.scale(scale, scale);
    pen.font = '12px system-ui, sans-serif';
    pen.fillStyle = getComputedStyle(canvas).getPropertyValue('--ink');
    for (const name of this.names.children) pen.fillText(name.textContent, parseFloat(name.style.left), parseFloat(name.style.top) + 11);
    return out.toDataURL('image/png');
  }

  save() {
    WM.element('a', { href: this.still(), download: 'windmark-3d.png' }).click();
  }
};

// Lines of the pyramid from a camera's station to the corners of its picture, as pairs of points.
WM.frustumLines = ({ center, corners }) => {
  const out = [];
  corners.forEach((corner, k) => out.push(...center, ...corner, ...corner, ...corners[(k + 1) % 4]));
  return out;
};
