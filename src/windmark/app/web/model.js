// What a scene shows, unpacked: surface, fields, cameras, markers, lines, a sequence.

WM.Model = class {
  constructor({ head, bytes }) {
    this.head = head;
    this.bytes = bytes;
    this.fields = head.fields;
    this.spots = head.markers ? head.markers.xyz : [];
    this.surface = head.surface ? this.unpackSurface(head.surface) : null;
    this.sequence = head.sequence ? this.unpackSequence(head.sequence) : null;
    this.frame = head.sequence ? head.sequence.first : 0;
    this.magnify = head.sequence ? head.sequence.magnify : 1;
    [this.center, this.radius] = this.bounds();
    if (this.sequence) this.place();
  }

  unpackSurface(of) {
    const columns = of.x.map((c) => WM.rounded(this.bytes, c));
    const count = columns[0].length;
    const rest = new Float32Array(3 * count);
    for (let k = 0; k < count; k++) for (let a = 0; a < 3; a++) rest[3 * k + a] = columns[a][k];
    return {
      count, rest, xyz: rest, step: of.x[0].step, corners: Uint32Array.from(WM.ints(this.bytes, of.corners)),
      edges: Uint32Array.from(WM.ints(this.bytes, of.edges)),
      volumes: of.volumes.map((v) => ({ ...v, on: v.on !== false })),
    };
  }

  unpackSequence(of) {
    const modes = of.modes.map((mode) => mode.map((column) => WM.rounded(this.bytes, column)));
    const sigmaModes = of.sigmaModes.map((mode) => WM.rounded(this.bytes, mode));
    return { ...of, modes, sigmaModes };
  }

  // Middle and size of what is to be in view: the surface in use, markers, not the cameras.
  bounds() {
    if (this.head.box) {
      const [low, high] = this.head.box;
      return [WM.scale(WM.add(low, high), 0.5), Math.max(0.5 * WM.length(WM.add(high, low, -1)), 1e-9)];
    }
    return [[0, 0, 0], 1];
  }

  // Values and sigmas of a field, from the page where they are not unpacked yet.
  async field(k) {
    const field = this.fields[k];
    if (!field.values) {
      const { head, bytes } = field.blob ? await WM.blob(field.blob) : { head: field, bytes: this.bytes };
      field.values = WM.rounded(bytes, head.value);
      field.sigmas = head.sigma ? WM.sigmas(bytes, head.sigma) : null;
      field.digits = head.sigma ? head.sigma.digits : 2;
      field.shifts = head.shifts;
    }
    return field;
  }

  // All cameras of now: those that stand still, and those of the frame.
  get cameras() {
    const { sequence, head } = this;
    return sequence && sequence.cameras.length ? [...head.cameras, ...sequence.cameras[this.frame]] : head.cameras;
  }

  // How far the node or marker `k` (these stand behind the nodes) is moved along an axis.
  moved(k, a) {
    const weights = this.sequence.weights[this.frame];
    let moved = 0;
    for (let m = 0; m < weights.length; m++) moved += weights[m] * this.sequence.modes[m][a][k];
    return moved;
  }

  // The surface of the frame of a sequence with its markers, and the length of its displacement and the sigma of that.
  place() {
    const { surface, sequence } = this;
    const nodes = surface ? surface.count : 0;
    if (surface) this.placeSurface();
    if (sequence.modes.length && sequence.modes[0][0].length > nodes) {
      this.spots = this.head.markers.xyz.map((rest, j) => rest.map((at, a) => at + this.magnify * this.moved(nodes + j, a)));
    }
  }

  placeSurface() {
    const { surface, sequence } = this;
    const xyz = new Float32Array(surface.rest.length);
    const sizes = new Float64Array(surface.count);
    for (let k = 0; k < surface.count; k++) {
      let square = 0;
      for (let a = 0; a < 3; a++) {
        const moved = this.moved(k, a);
        xyz[3 * k + a] = surface.rest[3 * k + a] + this.magnify * moved;
        square += moved * moved;
      }
      sizes[k] = Math.sqrt(square);
    }
    surface.xyz = xyz;
    if (sequence.field === null) return;
    const field = this.fields[sequence.field];
    field.values = sizes;
    const shares = sequence.sigmaWeights[this.frame];
    field.sigmas = null;
    if (shares.length) {
      field.sigmas = new Float64Array(surface.count);
      for (let k = 0; k < surface.count; k++) {
        let sigma = 0;
        for (let m = 0; m < shares.length; m++) sigma += shares[m] * sequence.sigmaModes[m][k];
        field.sigmas[k] = Math.max(sigma, 0);
      }
    }
  }
};
