// Functions of light direction, as relight-core evaluates them: an array of weights for a unit vector [x, y, z].

/** Exponents of x and y in the polynomials, in the order of .ptm files. */
const PTM_EXPONENTS = [
  [2, 0], [0, 2], [1, 1], [1, 0], [0, 1], [0, 0], [3, 0], [2, 1], [1, 2], [0, 3],
  [4, 0], [3, 1], [2, 2], [1, 3], [0, 4],
];

function ptmBasis({ degree }) {
  const exponents = PTM_EXPONENTS.slice(0, ((degree + 1) * (degree + 2)) / 2);
  return ([x, y]) => exponents.map(([i, j]) => x ** i * y ** j);
}

function shBasis({ order }) {
  return ([x, y, z]) => {
    const out = new Float64Array((order + 1) ** 2);
    let cos = 1;
    let sin = 0;
    let sectoral = Math.sqrt(1 / (4 * Math.PI));
    for (let m = 0; m <= order; m++) {
      let before = 0;
      let current = sectoral;
      for (let l = m; l <= order; l++) {
        const at = l * l + l;
        if (m === 0) {
          out[at] = current;
        } else {
          out[at + m] = Math.SQRT2 * current * cos;
          out[at - m] = Math.SQRT2 * current * sin;
        }
        const a = Math.sqrt((4 * (l + 1) ** 2 - 1) / ((l + 1) ** 2 - m * m));
        const b = l === m ? 0 : Math.sqrt((l * l - m * m) / (4 * l * l - 1));
        [before, current] = [current, a * (z * current - b * before)];
      }
      sectoral *= -Math.sqrt((2 * m + 3) / (2 * m + 2));
      [cos, sin] = [x * cos - y * sin, y * cos + x * sin];
    }
    return out;
  };
}

function hshBasis({ order }) {
  const root = (p, q) => Math.sqrt(p / (q * Math.PI));
  return (direction) => {
    const c = Math.max(direction[2], 0);
    const r = Math.sqrt(c / (1 + c));
    const [x, y] = [direction[0] * r, direction[1] * r];
    const [x2, y2] = [x * x - y * y, 2 * x * y];
    const [x3, y3] = [x * x2 - y * y2, x * y2 + y * x2];
    const t = 2 * c - 1;
    const q = 1 - 5 * c + 5 * c * c;
    return [
      root(1, 2),
      root(6, 1) * x,
      root(3, 2) * t,
      root(6, 1) * y,
      -root(30, 1) * x2,
      root(30, 1) * t * x,
      root(5, 2) * (1 - 6 * c + 6 * c * c),
      root(30, 1) * t * y,
      -root(30, 1) * y2,
      2 * root(35, 1) * x3,
      -root(210, 1) * t * x2,
      2 * root(21, 1) * q * x,
      root(7, 2) * (20 * c * c * c - 30 * c * c + 12 * c - 1),
      2 * root(21, 1) * q * y,
      -root(210, 1) * t * y2,
      2 * root(35, 1) * y3,
    ].slice(0, (order + 1) ** 2);
  };
}

/** The angle between two unit vectors, accurate where the arc cosine is not. */
function angleBetween(a, b) {
  const length = (sign) => Math.hypot(a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2]);
  return 2 * Math.atan2(length(-1), length(1));
}

function srbfBasis({ centres, spread, kernel }) {
  const squared = spread * spread;
  if (kernel === 'geodesic') {
    return (light) => centres.map((centre) => Math.exp(-(angleBetween(light, centre) ** 2) / (2 * squared)));
  }
  const cosine = (a, b) => Math.min(1, Math.max(-1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]));
  return (light) => centres.map((centre) => Math.exp((cosine(light, centre) - 1) / squared));
}

/** Numbers from halves in little endian in base 64. */
function numbersFromHalves(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float64Array.from({ length: bytes.length / 2 }, (_, i) => {
    const half = view.getUint16(2 * i, true);
    const exponent = (half >> 10) & 31;
    const fraction = half & 1023;
    const size = exponent === 0 ? fraction * 2 ** -24 : (1 + fraction / 1024) * 2 ** (exponent - 15);
    return half & 0x8000 ? -size : size;
  });
}

/** Where a direction lies on the unit square of an octahedral table. */
function octahedralPlace([x, y, z], hemisphere) {
  if (hemisphere) {
    const sum = Math.abs(x) + Math.abs(y) + Math.max(z, 0);
    const [p, q] = sum > 0 ? [x / sum, y / sum] : [1, 0];
    return [0.5 * (p + q + 1), 0.5 * (p - q + 1)];
  }
  const sum = Math.abs(x) + Math.abs(y) + Math.abs(z);
  const side = (value) => (value >= 0 ? 1 : -1);
  let [p, q] = [x / sum, y / sum];
  if (z < 0) {
    [p, q] = [(1 - Math.abs(q)) * side(p), (1 - Math.abs(p)) * side(q)];
  }
  return [0.5 * (p + 1), 0.5 * (q + 1)];
}

function learnedBasis({ planes, channels, nodes, hemisphere, table }) {
  const count = (planes + 1) * channels;
  const values = numbersFromHalves(table);
  return (light) => {
    const out = new Float64Array(count);
    const [[column, s], [row, t]] = octahedralPlace(light, hemisphere).map((place) => {
      const at = place * (nodes - 1);
      const before = Math.min(Math.max(Math.floor(at), 0), nodes - 2);
      return [before, Math.min(Math.max(at - before, 0), 1)];
    });
    const taps = [[0, 0, (1 - s) * (1 - t)], [1, 0, s * (1 - t)], [0, 1, (1 - s) * t], [1, 1, s * t]];
    for (const [dx, dy, weight] of taps) {
      const first = ((row + dy) * nodes + column + dx) * count;
      for (let j = 0; j < count; j++) {
        out[j] += weight * values[first + j];
      }
    }
    return out;
  };
}

const FAMILIES = { ptm: ptmBasis, sh: shBasis, hsh: hshBasis, srbf: srbfBasis, learned: learnedBasis };

/** The functions that an asset's record of its basis stands for. */
function basisOf(record) {
  return FAMILIES[record.family](record);
}
