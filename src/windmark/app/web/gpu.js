// Drawing with WebGL2: the surface with its colours, lines, dots, ellipsoids. Knows nothing of the page.

const SURFACE_VERTEX = `#version 300 es
layout(location=0) in vec3 place;
layout(location=1) in float value;
layout(location=2) in float known;
uniform mat4 matrix, view;
out vec3 eye; out float shown, has;
void main() {
  eye = (view * vec4(place, 1.0)).xyz; shown = value; has = known;
  gl_Position = matrix * vec4(place, 1.0);
}`;

// Colours of values are those of the colour bar, exactly: light would shift them. Shape shows in edges, in surfaces
// without a value, and, where it is asked for, as relief.
const SURFACE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 eye; in float shown, has;
uniform sampler2D palette; uniform vec2 range; uniform vec3 bare; uniform float relief; uniform bool coloured;
out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(eye), dFdy(eye)));
  float light = abs(dot(normal, normalize(eye)));
  if (coloured && has > 0.999) {
    float t = clamp((shown - range.x) / max(range.y - range.x, 1e-30), 0.0, 1.0);
    colour = vec4(texture(palette, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb * mix(1.0, 0.35 + 0.65 * light, relief), 1.0);
  } else colour = vec4(bare * (0.55 + 0.45 * light), 1.0);
}`;

const LINE_VERTEX = `#version 300 es
layout(location=0) in vec3 place;
uniform mat4 matrix; uniform float size, nearer;
void main() {
  gl_Position = matrix * vec4(place, 1.0);
  gl_Position.z -= nearer * gl_Position.w;
  gl_PointSize = size;
}`;

const LINE_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 ink; uniform bool round;
out vec4 colour;
void main() {
  float far = length(gl_PointCoord - 0.5);
  if (round && far > 0.5) discard;
  colour = round && far > 0.36 ? vec4(0.0, 0.0, 0.0, 1.0) : ink;
}`;

const BALL_VERTEX = `#version 300 es
layout(location=0) in vec3 place;
layout(location=1) in vec3 middle;
layout(location=2) in vec3 a;
layout(location=3) in vec3 b;
layout(location=4) in vec3 c;
uniform mat4 matrix, view;
out vec3 eye;
void main() {
  vec3 at = middle + mat3(a, b, c) * place;
  eye = (view * vec4(at, 1.0)).xyz;
  gl_Position = matrix * vec4(at, 1.0);
}`;

const BALL_FRAGMENT = `#version 300 es
precision highp float;
in vec3 eye; uniform vec4 ink; out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(eye), dFdy(eye)));
  colour = vec4(ink.rgb * (0.5 + 0.5 * abs(dot(normal, normalize(eye)))), ink.a);
}`;

WM.Gpu = class {
  constructor(canvas) {
    // The drawing is kept, so that it can be printed and saved as a picture.
    this.gl = canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error('no WebGL2');
    this.programs = {
      surface: this.program(SURFACE_VERTEX, SURFACE_FRAGMENT),
      line: this.program(LINE_VERTEX, LINE_FRAGMENT),
      ball: this.program(BALL_VERTEX, BALL_FRAGMENT),
    };
    this.palette = this.gl.createTexture();
    this.ball = this.makeBall();
  }

  program(vertex, fragment) {
    const { gl } = this;
    const out = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(out, shader);
    }
    gl.linkProgram(out);
    if (!gl.getProgramParameter(out, gl.LINK_STATUS)) throw new Error(`WebGL2: ${gl.getProgramInfoLog(out)}`);
    const places = new Map();
    return { use: () => gl.useProgram(out), at: (name) => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(out, name));
      return places.get(name);
    } };
  }

  buffer(array, old = null, target = this.gl.ARRAY_BUFFER) {
    const made = old || this.gl.createBuffer();
    this.gl.bindBuffer(target, made);
    this.gl.bufferData(target, array, this.gl.STATIC_DRAW);
    return made;
  }

  // Lines (pairs of points) or dots, ready to draw.
  points(array) {
    return { buffer: this.buffer(Float32Array.from(array)), count: array.length / 3 };
  }

  setPalette(colours) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, colours);
    for (const [what, how] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, what, how);
    }
  }

  // Places of the surface's nodes; indices only the first time.
  setSurface(surface) {
    const { gl } = this;
    const old = this.surface || {};
    this.surface = {
      place: this.buffer(surface.xyz, old.place),
      corners: old.corners || this.buffer(surface.corners, null, gl.ELEMENT_ARRAY_BUFFER),
      edges: old.edges || this.buffer(surface.edges, null, gl.ELEMENT_ARRAY_BUFFER),
      edgeCount: surface.edges.length, value: old.value, known: old.known,
    };
  }

  setValues(values, origin) {
    const shown = new Float32Array(values.length);
    const known = new Uint8Array(values.length);
    for (let k = 0; k < values.length; k++) {
      known[k] = Number.isFinite(values[k]) ? 255 : 0;
      shown[k] = known[k] ? values[k] - origin : 0;
    }
    this.surface.value = this.buffer(shown, this.surface.value);
    this.surface.known = this.buffer(known, this.surface.known);
  }

  begin(width, height, background) {
    const { gl } = this;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
  }

  attribute(place, buffer, size, type = this.gl.FLOAT, normalised = false, divisor = 0, stride = 0, offset = 0) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalised, stride, offset);
    gl.vertexAttribDivisor(place, divisor);
  }

  drawSurface(volumes, { matrix, view, range, bare, relief, coloured }) {
    const { gl } = this;
    const { surface } = this.programs;
    surface.use();
    gl.uniformMatrix4fv(surface.at('matrix'), false, matrix);
    gl.uniformMatrix4fv(surface.at('view'), false, view);
    gl.uniform2f(surface.at('range'), ...range);
    gl.uniform3f(surface.at('bare'), ...bare);
    gl.uniform1f(surface.at('relief'), relief);
    gl.uniform1i(surface.at('coloured'), coloured && this.surface.value ? 1 : 0);
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    this.attribute(0, this.surface.place, 3);
    if (this.surface.value) {
      this.attribute(1, this.surface.value, 1);
      this.attribute(2, this.surface.known, 1, gl.UNSIGNED_BYTE, true);
    } else for (const k of [1, 2]) gl.disableVertexAttribArray(k);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.surface.corners);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    for (const v of volumes) if (v.on) gl.drawElements(gl.TRIANGLES, 3 * v.count, gl.UNSIGNED_INT, 12 * v.first);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  useLine(matrix, ink, size, round, nearer) {
    const { gl } = this;
    const { line } = this.programs;
    line.use();
    gl.uniformMatrix4fv(line.at('matrix'), false, matrix);
    gl.uniform4f(line.at('ink'), ...ink);
    gl.uniform1f(line.at('size'), size);
    gl.uniform1f(line.at('nearer'), nearer);
    gl.uniform1i(line.at('round'), round ? 1 : 0);
    for (const k of [1, 2, 3, 4]) gl.disableVertexAttribArray(k);
  }

  drawEdges(matrix, ink) {
    const { gl } = this;
    this.useLine(matrix, ink, 1, false, 1e-5);
    this.attribute(0, this.surface.place, 3);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.surface.edges);
    gl.drawElements(gl.LINES, this.surface.edgeCount, gl.UNSIGNED_INT, 0);
  }

  drawLines(of, matrix, ink, nearer = 2e-5) {
    this.useLine(matrix, ink, 1, false, nearer);
    this.attribute(0, of.buffer, 3);
    this.gl.drawArrays(this.gl.LINES, 0, of.count);
  }

  drawDots(of, matrix, ink, size, nearer = 1e-3) {
    this.useLine(matrix, ink, size, true, nearer);
    this.attribute(0, of.buffer, 3);
    this.gl.drawArrays(this.gl.POINTS, 0, of.count);
  }

  makeBall() {
    const place = [];
    const at = (i, j) => {
      const up = (Math.PI * i) / 12;
      const round = (Math.PI * j) / 12;
      return [Math.sin(up) * Math.cos(round), Math.sin(up) * Math.sin(round), Math.cos(up)];
    };
    for (let i = 0; i < 12; i++) {
      for (let j = 0; j < 24; j++) {
        const [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        place.push(...a, ...b, ...c, ...a, ...c, ...d);
      }
    }
    return { buffer: this.buffer(Float32Array.from(place)), count: place.length / 3 };
  }

  // Ellipsoids from rows of twelve numbers: middle and the three semi-axes.
  drawBalls(of, matrix, view, ink) {
    const { gl } = this;
    const { ball } = this.programs;
    ball.use();
    gl.uniformMatrix4fv(ball.at('matrix'), false, matrix);
    gl.uniformMatrix4fv(ball.at('view'), false, view);
    gl.uniform4f(ball.at('ink'), ...ink);
    this.attribute(0, this.ball.buffer, 3);
    for (let k = 0; k < 4; k++) this.attribute(k + 1, of.buffer, 3, gl.FLOAT, false, 1, 48, 12 * k);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.drawArraysInstanced(gl.TRIANGLES, 0, this.ball.count, of.count / 4);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    for (let k = 1; k < 5; k++) {
      gl.vertexAttribDivisor(k, 0);
      gl.disableVertexAttribArray(k);
    }
  }
};
