// The eye that goes round the model, and the hands that move it: mouse, wheel, touch, keyboard.

const FOV = (30 * Math.PI) / 180;

WM.Orbit = class {
  constructor(model) {
    this.model = model;
    this.home();
  }

  home() {
    const { head, center, radius } = this.model;
    this.look(head.ahead, head.up);
    this.target = center.slice();
    this.distance = (1.1 * radius) / Math.sin(FOV / 2);
    this.fit = true; // as near as the picture's shape allows, once that is known
  }

  // The nearest distance from which all corners of the box are in a picture of this shape.
  nearest(aspect) {
    const { head } = this.model;
    if (!head.box) return this.distance;
    const up = 0.9 * Math.tan((aspect < 1 ? 2 * Math.atan(Math.tan(FOV / 2) / aspect) : FOV) / 2);
    let far = 0;
    for (let k = 0; k < 8; k++) {
      const p = WM.add([0, 1, 2].map((a) => head.box[(k >> a) & 1][a]), this.target, -1);
      const need = Math.max(Math.abs(WM.dot(p, this.right)) / (up * aspect), Math.abs(WM.dot(p, this.up)) / up);
      far = Math.max(far, need - WM.dot(p, this.ahead));
    }
    return far;
  }

  look(ahead, up) {
    this.ahead = WM.unit(ahead);
    this.right = WM.unit(WM.cross(this.ahead, up));
    this.up = WM.cross(this.right, this.ahead);
  }

  // As a camera of the test sees it: from its place, with its own field of view about the middle of the picture.
  from(camera) {
    const middle = WM.scale(camera.corners.reduce((a, b) => WM.add(a, b), [0, 0, 0]), 0.25);
    this.look(WM.add(middle, camera.center, -1), WM.add(camera.corners[0], camera.corners[3], -1));
    this.fit = false;
    const far = WM.dot(WM.add(this.model.center, camera.center, -1), this.ahead);
    this.distance = Math.max(far, 1e-3 * this.model.radius);
    this.target = WM.add(camera.center, this.ahead, this.distance);
  }

  // Goes with a camera from one pose to another, so that the camera seems to stand still and the model to move.
  carry(before, after) {
    const axes = ({ corners }) => {
      const x = WM.unit(WM.add(corners[1], corners[0], -1));
      const z = WM.unit(WM.cross(x, WM.add(corners[3], corners[0], -1)));
      return [x, WM.cross(z, x), z];
    };
    const [from, to] = [axes(before), axes(after)];
    const turned = (v) => from.reduce((sum, axis, k) => WM.add(sum, to[k], WM.dot(v, axis)), [0, 0, 0]);
    this.target = WM.add(after.center, turned(WM.add(this.target, before.center, -1)));
    this.look(turned(this.ahead), turned(this.up));
    this.fit = false;
  }

  get eye() {
    return WM.add(this.target, this.ahead, -this.distance);
  }

  // Matrices for a picture of this shape. All that is drawn is within four model sizes of the target, or it is cut.
  matrices(aspect) {
    const { radius } = this.model;
    if (this.fit) this.distance = this.nearest(aspect);
    this.fit = false;
    const fov = aspect < 1 ? 2 * Math.atan(Math.tan(FOV / 2) / aspect) : FOV;
    const far = this.distance + (this.model.head.reach || 4 * radius);
    const near = Math.max(this.distance - (this.model.head.reach || 4 * radius), far / 5000);
    const view = WM.lookAt(this.eye, this.ahead, this.up);
    return { view, matrix: WM.times(WM.perspective(fov, aspect, near, far), view) };
  }

  turn(across, down) {
    const upright = WM.unit(this.model.head.up);
    // Upside down, the model turns the other way under the hand.
    const sign = WM.dot(this.up, upright) < 0 ? -1 : 1;
    this.ahead = WM.turn(this.ahead, upright, -across * sign);
    this.up = WM.turn(this.up, upright, -across * sign);
    this.look(this.ahead, this.up);
    this.ahead = WM.turn(this.ahead, this.right, -down);
    this.up = WM.cross(this.right, this.ahead);
  }

  shift(across, down) {
    const step = 2 * this.distance * Math.tan(FOV / 2);
    this.target = WM.add(WM.add(this.target, this.right, -across * step), this.up, down * step);
  }

  zoom(factor) {
    const { radius } = this.model;
    this.distance = Math.min(Math.max(this.distance * factor, 2e-3 * radius), 100 * radius);
  }
};

// Hands on a canvas; `changed` is called after every move.
WM.hands = (canvas, orbit, changed) => {
  const fingers = new Map();
  let pinch = 0;
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener('pointerdown', (e) => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (fingers.size === 2) pinch = spread();
  });
  canvas.addEventListener('pointermove', (e) => {
    const was = fingers.get(e.pointerId);
    if (!was) return;
    const [dx, dy] = [(e.clientX - was.x) / canvas.clientHeight, (e.clientY - was.y) / canvas.clientHeight];
    fingers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (fingers.size === 2) {
      const now = spread();
      orbit.zoom(pinch / Math.max(now, 1));
      orbit.shift(dx / 2, dy / 2);
      pinch = now;
    } else if (e.buttons & 2 || e.shiftKey) orbit.shift(dx, dy);
    else orbit.turn(dx * Math.PI, dy * Math.PI);
    changed();
  });
  for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
  canvas.addEventListener('contextmenu', (e) => e.preventDefault());
  canvas.addEventListener('wheel', (e) => {
    if (document.activeElement !== canvas && !e.ctrlKey) return; // the page scrolls over it
    e.preventDefault();
    orbit.zoom(Math.exp(0.0015 * e.deltaY * (e.deltaMode ? 20 : 1)));
    changed();
  }, { passive: false });
  canvas.addEventListener('keydown', (e) => {
    const step = e.shiftKey ? 0.02 : 0.1;
    const moves = {
      ArrowLeft: () => orbit.turn(-step, 0), ArrowRight: () => orbit.turn(step, 0),
      ArrowUp: () => orbit.turn(0, -step), ArrowDown: () => orbit.turn(0, step),
      '+': () => orbit.zoom(0.9), '=': () => orbit.zoom(0.9), '-': () => orbit.zoom(1.1),
      '0': () => orbit.home(), Home: () => orbit.home(),
    };
    if (!moves[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    moves[e.key]();
    changed();
  });
  canvas.addEventListener('dblclick', () => {
    orbit.home();
    changed();
  });
};
