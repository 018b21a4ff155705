// From the text of a report back to arrays: base 85, gzip (the browser's own), byte planes, differences.
// The other half of app/packing.py.

WM.canUnpack = () => typeof DecompressionStream === 'function';

const DIGITS = '0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+-;=>?@^_`{|}~.,:';

// "LENGTH|digits": five digits are four bytes, the first the highest.
const base85 = (text) => {
  const begin = text.indexOf('|') + 1;
  const value = new Uint8Array(128);
  for (let k = 0; k < 85; k++) value[DIGITS.charCodeAt(k)] = k;
  const out = new Uint8Array(((text.length - begin) / 5) * 4);
  for (let i = begin, o = 0; i < text.length; i += 5, o += 4) {
    let number = 0;
    for (let k = 0; k < 5; k++) number = number * 85 + value[text.charCodeAt(i + k)];
    for (let k = 3; k >= 0; k--) {
      out[o + k] = number % 256;
      number = Math.floor(number / 256);
    }
  }
  return out.subarray(0, parseInt(text, 10));
};

// The document and its bytes: {head, bytes}; arrays are read with WM.ints, WM.rounded and WM.sigmas.
WM.unpack = async (text) => {
  const packed = base85(text.trim());
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  const whole = await new Response(stream).arrayBuffer();
  const length = new DataView(whole).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(whole, 4, length)));
  return { head, bytes: new Uint8Array(whole, 4 + length) };
};

WM.ints = (bytes, of) => {
  const out = new Int32Array(of.n);
  for (let k = 0; k < of.n; k++) {
    let folded = 0;
    for (let p = of.planes - 1; p >= 0; p--) folded = folded * 256 + bytes[of.at + p * of.n + k];
    // Beyond 32 bits shifts would cut: halves are taken as numbers.
    out[k] = folded % 2 ? -(folded + 1) / 2 : folded / 2;
  }
  for (let t = 0; t < of.times; t++) {
    for (let k = of.lag; k < of.n; k++) out[k] += out[k - of.lag];
  }
  return out;
};

const known = (bytes, at, k) => at === undefined || ((bytes[at + (k >> 3)] >> (k & 7)) & 1) === 1;

WM.rounded = (bytes, of) => {
  const codes = WM.ints(bytes, of.codes);
  const out = new Float64Array(codes.length);
  for (let k = 0; k < codes.length; k++) {
    out[k] = known(bytes, of.known, k) ? of.offset + of.step * codes[k] : NaN;
  }
  return out;
};

WM.sigmas = (bytes, of) => {
  const codes = WM.ints(bytes, of.codes);
  const out = new Float64Array(codes.length);
  for (let k = 0; k < codes.length; k++) {
    const size = codes[k] === 0 ? 0 : of.least * Math.pow(of.ratio, codes[k] - 1);
    out[k] = known(bytes, of.known, k) ? size : NaN;
  }
  return out;
};

// Text of a <script> that holds data, once; gone from the page afterwards, so that it is not kept twice.
WM.blob = async (id) => {
  const element = document.getElementById(id);
  if (!element) throw new Error(`this page has no part ${id}`);
  const out = await WM.unpack(element.textContent);
  element.textContent = '';
  return out;
};
