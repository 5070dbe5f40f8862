// The asset: its planes out of their pictures, and relighting in plain script.

function encodedFromLinear(value) {
  return value <= 0.0031308 ? Math.max(12.92 * value, 0) : 1.055 * value ** (1 / 2.4) - 0.055;
}

/** The 8-bit code of a value from 0 to 1. */
function codeOf(value) {
  return Math.floor(Math.min(Math.max(value, 0), 1) * 255 + 0.5);
}

/** RGBA codes of a PNG as they are stored: no colour management, no alpha. */
async function codesOfImage(uri, width, height) {
  const image = new Image();
  image.src = uri;
  await image.decode();
  const bitmap = await createImageBitmap(image, { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
  const canvas = document.createElement('canvas');
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext('2d', { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, width, height).data;
}

class Asset {
  /** `details` as the page's data has them; `load` comes next. */
  constructor(details) {
    this.details = details;
    this.width = details.width;
    this.height = details.height;
    this.channels = details.channels;
    this.functions = basisOf(details.basis);
    this.linear = details.space === 'linear';
    this.hasBase = details.roles.some((role) => 'base' in role);
    this.images = [];
  }

  async load() {
    const { images, width, height } = this.details;
    for (const uri of images) {
      this.images.push(await codesOfImage(uri, width, height));
    }
  }

  /** The nearest direction that the capture knows; relight itself lets light fade beyond. */
  known(direction) {
    const { axis, radius } = this.details.horizon;
    const angle = angleBetween(direction, axis);
    if (angle <= radius) {
      return direction;
    }
    const cosine = direction.reduce((sum, value, i) => sum + value * axis[i], 0);
    const aside = direction.map((value, i) => value - cosine * axis[i]);
    const length = Math.hypot(...aside) || 1;
    return axis.map((value, i) => Math.cos(radius) * value + (Math.sin(radius) * aside[i]) / length);
  }

  /** By plane, how much it counts in R, G and B under `direction`, and what these are without any plane. */
  weights(direction) {
    const { roles, mean } = this.details;
    const functions = this.functions(direction);
    const of = (list) => [0, 1, 2].map((channel) => {
      const found = list[this.channels === 1 ? 0 : channel];
      return found === null ? 0 : functions[found];
    });
    return {
      constant: of(mean),
      planes: roles.map((role) => ('base' in role ? [0, 0, 0] : of(role.functions))),
    };
  }

  /** By plane, whether it is the base colour of R, G or B. */
  baseWeights() {
    return this.details.roles.map((role) => [0, 1, 2].map((channel) => (role.base === channel ? 1 : 0)));
  }

  /**
   * The same by run of bytes, gains and biases worked in: a channel is `constant` plus the sum over runs of
   * `runs[3 * run + channel]` x byte.
   */
  termsOf({ constant, planes }) {
    const { bias, runs } = this.details;
    const sums = [...constant];
    planes.forEach((weights, plane) => weights.forEach((weight, c) => { sums[c] += weight * bias[plane]; }));
    const terms = new Float64Array(this.images.length * 9);
    runs.forEach(([plane, gain], run) => {
      planes[plane].forEach((weight, c) => { terms[3 * run + c] = weight * gain; });
    });
    return { constant: sums, runs: terms };
  }

  /** Adds up `terms` at every `step`th pixel: three values each. */
  sums(terms, step) {
    const columns = Math.ceil(this.width / step);
    const rows = Math.ceil(this.height / step);
    const out = new Float64Array(columns * rows * 3);
    for (let i = 0; i < out.length; i++) {
      out[i] = terms.constant[i % 3];
    }
    this.images.forEach((image, number) => {
      const t = terms.runs.subarray(9 * number, 9 * number + 9);
      let at = 0;
      for (let y = 0; y < this.height; y += step) {
        for (let x = 0; x < this.width; x += step, at += 3) {
          const i = 4 * (y * this.width + x);
          const [r, g, b] = [image[i], image[i + 1], image[i + 2]];
          out[at] += t[0] * r + t[3] * g + t[6] * b;
          out[at + 1] += t[1] * r + t[4] * g + t[7] * b;
          out[at + 2] += t[2] * r + t[5] * g + t[8] * b;
        }
      }
    });
    return out;
  }

  /** The picture under `direction`, every `step`th pixel of it, as ImageData. */
  relit(direction, step = 1) {
    const values = this.sums(this.termsOf(this.weights(direction)), step);
    if (this.hasBase) {
      this.sums(this.termsOf({ constant: [0, 0, 0], planes: this.baseWeights() }), step)
        .forEach((factor, i) => { values[i] *= factor; });
    }
    const picture = new ImageData(Math.ceil(this.width / step), Math.ceil(this.height / step));
    for (let i = 0, at = 0; i < values.length; i += 3, at += 4) {
      for (let c = 0; c < 3; c++) {
        picture.data[at + c] = codeOf(this.linear ? encodedFromLinear(values[i + c]) : values[i + c]);
      }
      picture.data[at + 3] = 255;
    }
    return picture;
  }

  /** The coefficients of all planes at a pixel. */
  coefficients(x, y) {
    const { bias, runs } = this.details;
    const values = Float64Array.from(bias);
    const at = 4 * (y * this.width + x);
    runs.forEach(([plane, gain], run) => {
      values[plane] += gain * this.images[Math.floor(run / 3)][at + (run % 3)];
    });
    return values;
  }

  /** The base colour that is among `coefficients`. */
  baseAt(coefficients) {
    const base = [1, 1, 1];
    this.details.roles.forEach((role, plane) => {
      if ('base' in role) {
        base[role.base] = coefficients[plane];
      }
    });
    return base;
  }

  /** What `coefficients` and their `base` colour come to with `weights`: R, G and B, encoded, not clipped above. */
  valueOf({ constant, planes }, coefficients, base) {
    const values = [...constant];
    planes.forEach((weights, plane) => weights.forEach((weight, c) => { values[c] += weight * coefficients[plane]; }));
    values.forEach((value, c) => { values[c] = value * base[c]; });
    return this.linear ? values.map(encodedFromLinear) : values;
  }

  /** The same under `direction`. */
  value(coefficients, direction) {
    return this.valueOf(this.weights(direction), coefficients, this.baseAt(coefficients));
  }
}
