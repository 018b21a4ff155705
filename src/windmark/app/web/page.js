// The page round the scenes: starts them, zooms pictures, copies tables, opens what is packed, prepares printing.

WM.scenes = [];

WM.start = async (node) => {
  const fallback = node.querySelector('.wm-fallback');
  try {
    if (!WM.canUnpack()) throw new Error('this browser has no DecompressionStream');
    WM.scenes.push(await WM.Scene.make(node));
    node.classList.add('wm-ready');
  } catch (error) {
    fallback.textContent = `This browser cannot turn the model (${error.message}): the 3D view needs WebGL2 and `
      + 'DecompressionStream, which current Firefox, Chrome, Edge and Safari have. All figures are in the tables.';
    node.classList.add('wm-failed');
  }
};

// Names over a picture are never smaller than LEAST pixels of the screen; those that would then lie over others wait for the zoom.
WM.LEAST = 9;
WM.legible = (frame) => {
  const drawn = frame.querySelector('svg');
  const names = drawn ? [...drawn.querySelectorAll('text')] : [];
  if (!names.length) return;
  const given = parseFloat(frame.style.getPropertyValue('--name'));
  const crowded = new Set(names.filter((name) => name.classList.contains('crowded')));
  let before = 0;
  new ResizeObserver(() => {
    const width = frame.clientWidth;
    if (!width || width === before) return;
    before = width;
    const least = (WM.LEAST * drawn.viewBox.baseVal.width) / width;
    frame.style.setProperty('--least', `${least}px`);
    const grown = Math.max(least / given, 1);
    const taken = [];
    for (const name of names) {
      const hidden = crowded.has(name) || (grown > 1 && !WM.room(name, given * grown, taken));
      name.classList.toggle('crowded', hidden);
    }
  }).observe(frame);
};

// Whether a name of such a size lies over none of those before it.
WM.room = (name, size, taken) => {
  const wide = 0.8 * size * name.textContent.length;
  const [x, y] = [Number(name.getAttribute('x')), Number(name.getAttribute('y'))];
  const left = name.getAttribute('text-anchor') === 'end' ? x - wide : x;
  const box = [left, y - 0.8 * size, left + wide, y + 0.2 * size];
  if (taken.some((o) => o[0] < box[2] && box[0] < o[2] && o[1] < box[3] && box[1] < o[3])) return false;
  taken.push(box);
  return true;
};

// Wheel and buttons zoom into a picture, down to its pixels; dragging moves it; a double click shows all of it.
WM.zoomable = (frame) => {
  const inner = frame.firstElementChild;
  const state = { x: 0, y: 0, zoom: 1 };
  WM.legible(frame);
  const apply = () => {
    const [w, h] = [frame.clientWidth, frame.clientHeight];
    state.zoom = Math.min(Math.max(state.zoom, 1), 64);
    state.x = Math.min(Math.max(state.x, w * (1 - state.zoom)), 0);
    state.y = Math.min(Math.max(state.y, h * (1 - state.zoom)), 0);
    inner.style.transform = `translate(${state.x}px, ${state.y}px) scale(${state.zoom})`;
    frame.style.setProperty('--zoom', state.zoom);
    frame.classList.toggle('wm-close', state.zoom > 1);
  };
  const at = (x, y, factor) => {
    const zoom = Math.min(Math.max(state.zoom * factor, 1), 64);
    state.x = x - ((x - state.x) * zoom) / state.zoom;
    state.y = y - ((y - state.y) * zoom) / state.zoom;
    state.zoom = zoom;
    apply();
  };
  const spot = (e) => {
    const { left, top } = frame.getBoundingClientRect();
    return [e.clientX - left, e.clientY - top];
  };
  frame.addEventListener('wheel', (e) => {
    if (!e.ctrlKey && !frame.matches(':focus, :focus-within, .wm-close')) return; // the page scrolls over it
    e.preventDefault();
    at(...spot(e), Math.exp(-0.0015 * e.deltaY * (e.deltaMode ? 20 : 1)));
  }, { passive: false });
  let held = null;
  frame.addEventListener('pointerdown', (e) => {
    held = [e.clientX, e.clientY];
    frame.setPointerCapture(e.pointerId);
  });
  frame.addEventListener('pointermove', (e) => {
    if (!held || state.zoom === 1) return;
    state.x += e.clientX - held[0];
    state.y += e.clientY - held[1];
    held = [e.clientX, e.clientY];
    apply();
  });
  frame.addEventListener('pointerup', () => { held = null; });
  frame.addEventListener('dblclick', (e) => {
    if (state.zoom > 1) at(0, 0, 1e-9);
    else at(...spot(e), 6);
  });
  frame.addEventListener('keydown', (e) => {
    if (e.key === '+' || e.key === '=') at(frame.clientWidth / 2, frame.clientHeight / 2, 1.5);
    if (e.key === '-') at(frame.clientWidth / 2, frame.clientHeight / 2, 1 / 1.5);
    if (e.key === 'Escape' || e.key === '0') at(0, 0, 1e-9);
  });
};

// Layers of a picture on and off.
WM.layers = (figure) => {
  for (const box of figure.querySelectorAll('input[data-layer]')) {
    box.addEventListener('change', () => {
      figure.classList.toggle(`wm-no-${box.dataset.layer}`, !box.checked);
      for (const drawn of figure.querySelectorAll(`g[data-of="${box.dataset.layer}"]`)) drawn.style.display = box.checked ? '' : 'none';
    });
  }
};

// A table as tab-separated text, as spreadsheets take it.
WM.tableText = (table) => [...table.rows]
  .map((row) => [...row.cells].map((c) => c.textContent.trim().replace(/\u2212/g, '-').replace(/\s+/g, ' ')).join('\t'))
  .join('\n');

WM.copyable = (table) => {
  const copy = WM.button('copy', 'copy this table for a spreadsheet', async () => {
    const text = WM.tableText(table);
    try {
      await navigator.clipboard.writeText(text);
    } catch { // pages opened from a file may not be let: the old way
      const area = document.body.appendChild(WM.element('textarea', {}));
      area.value = text;
      area.select();
      document.execCommand('copy');
      area.remove();
    }
    copy.textContent = 'copied';
    setTimeout(() => { copy.textContent = 'copy'; }, 1500);
  });
  copy.className = 'wm-copy';
  const box = table.closest('.scroll') || table;
  box.before(WM.element('div', { class: 'wm-copy-row' }, copy));
};

// A part that is packed until it is looked at.
WM.open = async (details) => {
  const id = details.dataset.blob;
  if (!id) return;
  delete details.dataset.blob;
  const body = details.querySelector('.wm-packed');
  try {
    const { bytes } = await WM.blob(id);
    body.innerHTML = new TextDecoder().decode(bytes);
    WM.liven(body);
  } catch (error) {
    body.textContent = `This part cannot be unpacked (${error.message}).`;
  }
};

WM.liven = (root) => {
  root.querySelectorAll('.wm-zoom').forEach(WM.zoomable);
  root.querySelectorAll('figure').forEach(WM.layers);
  root.querySelectorAll('table').forEach(WM.copyable);
  root.querySelectorAll('details[data-blob]').forEach((d) => d.addEventListener('toggle', () => d.open && WM.open(d)));
  root.querySelectorAll('[data-field]').forEach((b) => b.addEventListener('click', async () => {
    const scene = WM.scenes.find((s) => s.model.fields.some((f) => f.key === b.dataset.field));
    if (!scene) return;
    const k = scene.model.fields.findIndex((f) => f.key === b.dataset.field);
    await scene.choose(k);
    scene.node.scrollIntoView({ behavior: 'smooth' });
  }));
};

// A link into a packed part opens it.
WM.follow = async () => {
  const part = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!part || part.tagName !== 'DETAILS') return;
  part.open = true;
  await WM.open(part);
  part.scrollIntoView();
};

document.addEventListener('DOMContentLoaded', async () => {
  WM.liven(document);
  await Promise.all([...document.querySelectorAll('.wm-scene')].map(WM.start));
  await Promise.all([...document.querySelectorAll('details[open][data-blob]')].map(WM.open));
  window.addEventListener('hashchange', WM.follow);
  await WM.follow();
  document.documentElement.dataset.ready = 'yes';
});

// On paper a scene is the picture that it shows just now.
window.addEventListener('beforeprint', () => {
  document.documentElement.dataset.paper = 'yes'; // dark or not, paper is light
  // What is only folded is printed; what is packed, one of very many, is not.
  WM.unfolded = [...document.querySelectorAll('details:not([open]):not([data-blob])')];
  for (const part of WM.unfolded) part.open = true;
  for (const scene of WM.scenes) scene.node.querySelector('.wm-still').src = scene.still();
});
window.addEventListener('afterprint', () => {
  delete document.documentElement.dataset.paper;
  for (const part of WM.unfolded) part.open = false;
  for (const scene of WM.scenes) scene.redraw();
});
