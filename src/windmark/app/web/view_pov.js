// The point of view: seven sliders (the paper's Fig. 5); the server projects the grid through the picture's own lens.

const NUMBERS = ['rx', 'ry', 'rz', 'dx', 'dy', 'dz', 'fov'];
const MOST_FOV = 170;

const rangeOf = (name, start, reach) => {
  if (name === 'fov') return [start / 8, Math.min(Math.max(4 * start, 1), Math.max(MOST_FOV, start)), start / 2000];
  return name[0] === 'r' ? [start - 180, start + 180, 0.02] : [start - reach, start + reach, reach / 5000];
};

// Seven digits are enough for any of them; a box is for typing, too.
const short = (value) => String(Number(value.toPrecision(7)));

function pointOfView(view, figure) {
  const image = view.dataset.image;
  const about = data.images[image];
  const details = WM.element('details', { class: 'wm-pov' });
  details.innerHTML = '<summary>Point of view: move the camera, see the grid</summary><div class="wm-sliders"></div>'
    + '<div class="wm-pov-row"><button type="button" class="wm-home">back to where the run has it</button>'
    + '<span>virtual view from there: <button type="button" data-kind="png">PNG</button> '
    + '<button type="button" data-kind="tiff">TIFF (values)</button></span><span class="wm-pov-words" role="status"></span></div>';
  const words = details.querySelector('.wm-pov-words');
  const values = { ...about.pov };
  const inputs = {};
  const drawing = figure.querySelector('.wm-zoom svg');
  let layer = null;
  let [asked, waiting] = [false, false];

  const draw = (seen) => {
    const fresh = svg('g', { class: 'live-view' });
    if (seen.path) fresh.append(svg('path', { class: 'live', d: seen.path }));
    const arm = about.size[0] / 220;
    for (const [name, x, y] of seen.markers) {
      fresh.append(svg('path', { class: 'live-marker', d: `M${x - arm} ${y}h${2 * arm}M${x} ${y - arm}v${2 * arm}` }, `${name} from this point of view`));
    }
    if (layer) layer.remove();
    layer = drawing.insertBefore(fresh, drawing.firstChild);
    words.classList.remove('bad');
    words.textContent = [
      about.grid ? `${seen.nodes} nodes seen` : 'no grid', `${seen.markers.length} markers in the picture`,
      ...(seen.rms === null ? [] : [`${Number(seen.rms.toPrecision(3))} px RMS to their spots`]),
    ].join(' · ');
  };
  // One question at a time: while it is answered the sliders may move on, and only the last place is asked for.
  const redraw = async () => {
    if (asked) {
      waiting = true;
      return;
    }
    asked = true;
    do {
      waiting = false;
      try {
        const seen = await ask('/grid', { image, ...values });
        if (details.open) draw(seen);
      } catch (error) {
        words.textContent = error.message;
        words.classList.add('bad');
      }
    } while (waiting);
    asked = false;
  };
  const put = (name, value) => {
    values[name] = value;
    inputs[name].slider.value = value;
    inputs[name].box.value = short(value);
  };
  const build = () => {
    const rows = NUMBERS.map((name) => {
      const [least, most, step] = rangeOf(name, about.pov[name], about.reach);
      const slider = WM.element('input', { type: 'range', min: least, max: most, step: step, 'aria-label': name });
      const box = WM.element('input', { type: 'number', step: 'any', 'aria-label': `${name}, number` });
      slider.addEventListener('input', () => {
        put(name, Number(slider.value));
        redraw();
      });
      box.addEventListener('input', () => {
        if (box.value === '' || !Number.isFinite(Number(box.value))) return;
        values[name] = Number(box.value);
        slider.value = box.value;
        redraw();
      });
      inputs[name] = { slider, box };
      const label = WM.element('label', {});
      const unit = WM.element('span', {});
      unit.textContent = name[0] === 'd' ? data.unit : 'deg';
      label.append(name, slider, box, unit);
      return label;
    });
    details.querySelector('.wm-sliders').replaceChildren(...rows);
    NUMBERS.forEach((name) => put(name, about.pov[name]));
  };
  details.addEventListener('toggle', () => {
    if (!details.open) {
      if (layer) layer.remove();
      layer = null;
      return;
    }
    if (!inputs.rx) build();
    redraw();
  });
  details.querySelector('.wm-home').addEventListener('click', () => {
    NUMBERS.forEach((name) => put(name, about.pov[name]));
    redraw();
  });
  for (const button of details.querySelectorAll('[data-kind]')) {
    button.disabled = !about.posed || !about.grid;
    button.addEventListener('click', async () => {
      try {
        const answer = await request('/export', { image, kind: button.dataset.kind, ...values });
        const link = WM.element('a', { download: `${image}-view.${button.dataset.kind === 'png' ? 'png' : 'tif'}` });
        link.href = URL.createObjectURL(await answer.blob());
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      } catch (error) {
        words.textContent = error.message;
        words.classList.add('bad');
      }
    });
  }
  figure.before(details);
}
