// Colours, ticks and numbers with the digits that their sigma earns.

// 256 colours (RGBA bytes) between the given stops ("#rrggbb").
WM.palette = (stops) => {
  const rgb = stops.map((s) => [1, 3, 5].map((k) => parseInt(s.slice(k, k + 2), 16)));
  const out = new Uint8Array(1024);
  for (let k = 0; k < 256; k++) {
    const t = (k / 255) * (rgb.length - 1);
    const a = Math.min(Math.floor(t), rgb.length - 2);
    for (let c = 0; c < 3; c++) out[4 * k + c] = Math.round(rgb[a][c] + (t - a) * (rgb[a + 1][c] - rgb[a][c]));
    out[4 * k + 3] = 255;
  }
  return out;
};

// Round numbers (1, 2, 5 times a power of ten apart) from low to high, about so many.
WM.ticks = (low, high, about = 8) => {
  const span = high - low;
  if (!(span > 0) || !Number.isFinite(span)) return [low];
  const raw = span / about;
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].find((m) => m * power >= raw * (1 - 1e-9)) * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) out.push(k * step);
  return out;
};

const minus = (text) => text.replace('-', '\u2212');

// Ticks as text, all with the same number of decimals.
WM.tickTexts = (ticks) => {
  const step = ticks.length > 1 ? ticks[1] - ticks[0] : Math.abs(ticks[0]) || 1;
  const largest = Math.max(...ticks.map(Math.abs));
  if (largest >= 1e6 || (largest > 0 && largest < 1e-4)) {
    const digits = Math.max(0, Math.floor(Math.log10(largest)) - Math.floor(Math.log10(step) + 1e-9));
    return ticks.map((t) => minus(t === 0 ? '0' : t.toExponential(digits)));
  }
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return ticks.map((t) => minus((Math.abs(t) < 1e-9 * step ? 0 : t).toFixed(decimals)));
};

// A value as far as its sigma tells (two digits of sigma, or as many as it has), and the sigma; four digits without.
WM.withSigma = (value, sigma, digits = 2) => {
  if (!Number.isFinite(value)) return 'no value';
  if (!(sigma > 0)) return minus(WM.digits(value, 4)) + (sigma === 0 ? ' (exact)' : '');
  const place = digits - 1 - Math.floor(Math.log10(sigma));
  if (place < -5 || place > 8) return minus(`${value.toExponential(3)} ± ${sigma.toExponential(1)}`);
  const p = Math.max(place, 0);
  const cut = (x) => (place < 0 ? Math.round(x * 10 ** place) / 10 ** place : x).toFixed(p);
  return minus(`${cut(value)} ± ${cut(sigma)}`);
};

WM.digits = (value, digits) => {
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1);
  return value.toFixed(Math.max(0, digits - 1 - Math.floor(Math.log10(size))));
};

WM.hex = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16) / 255);
