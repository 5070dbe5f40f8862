// The live picture: planes as an array texture, weighed by a shader; in plain script where WebGL2 is missing.

const VERTEX_SHADER = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
precision highp sampler2D;
precision highp sampler2DArray;
uniform sampler2DArray planes;
// A row a layer: what its three bytes count in R, G, B, then in the base colour.
uniform sampler2D weights;
uniform int layers;
uniform int height;
uniform vec3 constant;
uniform vec3 baseConstant;
uniform bool hasBase;
uniform bool isLinear;
out vec4 color;

vec3 weighed(vec3 bytes, int first, int layer) {
  return vec3(
    dot(texelFetch(weights, ivec2(first, layer), 0).rgb, bytes),
    dot(texelFetch(weights, ivec2(first + 1, layer), 0).rgb, bytes),
    dot(texelFetch(weights, ivec2(first + 2, layer), 0).rgb, bytes));
}

void main() {
  ivec2 at = ivec2(int(gl_FragCoord.x), height - 1 - int(gl_FragCoord.y));
  vec3 sum = constant;
  vec3 base = baseConstant;
  for (int layer = 0; layer < layers; layer++) {
    vec3 bytes = texelFetch(planes, ivec3(at, layer), 0).rgb * 255.0;
    sum += weighed(bytes, 0, layer);
    if (hasBase) {
      base += weighed(bytes, 3, layer);
    }
  }
  if (hasBase) {
    sum *= base;
  }
  if (isLinear) {
    vec3 dark = max(12.92 * sum, 0.0);
    vec3 light = 1.055 * pow(max(sum, 0.0031308), vec3(1.0 / 2.4)) - 0.055;
    sum = mix(light, dark, vec3(lessThanEqual(sum, vec3(0.0031308))));
  }
  color = vec4(floor(clamp(sum, 0.0, 1.0) * 255.0 + 0.5) / 255.0, 1.0);
}`;

function compiled(gl, kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return shader;
}

/** A function that draws `asset` under a direction on `canvas`, or null where WebGL2 can't. */
function webglPainter(canvas, asset) {
  const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true });
  const layers = asset.images.length;
  if (!gl || layers > gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS)) {
    return null;
  }
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl, gl.VERTEX_SHADER, VERTEX_SHADER));
  gl.attachShader(program, compiled(gl, gl.FRAGMENT_SHADER, FRAGMENT_SHADER));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    return null;
  }
  gl.useProgram(program);
  const place = (name) => gl.getUniformLocation(program, name);
  const texture = (unit, target) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  };
  const { width, height } = asset;
  texture(0, gl.TEXTURE_2D_ARRAY);
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, layers);
  asset.images.forEach((image, layer) => {
    const bytes = new Uint8Array(image.buffer);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  });
  texture(1, gl.TEXTURE_2D);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, 6, layers);
  gl.uniform1i(place('planes'), 0);
  gl.uniform1i(place('weights'), 1);
  gl.uniform1i(place('layers'), layers);
  gl.uniform1i(place('height'), height);
  gl.uniform1i(place('isLinear'), asset.linear ? 1 : 0);
  gl.uniform1i(place('hasBase'), asset.hasBase ? 1 : 0);
  gl.viewport(0, 0, width, height);
  if (gl.getError() !== gl.NO_ERROR) {
    return null;
  }
  const table = new Float32Array(layers * 6 * 4);
  const fill = (terms, first) => {
    for (let run = 0; run < layers * 3; run++) {
      const row = 24 * Math.floor(run / 3);
      for (let c = 0; c < 3; c++) {
        table[row + 4 * (first + c) + (run % 3)] = terms.runs[3 * run + c];
      }
    }
    return terms.constant;
  };
  const base = asset.termsOf({ constant: [0, 0, 0], planes: asset.baseWeights() });
  gl.uniform3fv(place('baseConstant'), fill(base, 3));
  const constant = place('constant');
  return (direction) => {
    gl.uniform3fv(constant, fill(asset.termsOf(asset.weights(direction)), 0));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 6, layers, gl.RGBA, gl.FLOAT, table);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };
}

/** The same in plain script. */
function plainPainter(canvas, asset) {
  const context = canvas.getContext('2d', { alpha: false });
  return (direction) => context.putImageData(asset.relit(direction), 0, 0);
}

/** A canvas, how to draw a direction on it, and in words what draws; `?canvas` in the address asks for plain script. */
function painterOf(asset) {
  const newCanvas = () => {
    const canvas = document.createElement('canvas');
    canvas.width = asset.width;
    canvas.height = asset.height;
    return canvas;
  };
  if (!new URLSearchParams(location.search).has('canvas')) {
    const canvas = newCanvas();
    const paint = webglPainter(canvas, asset);
    if (paint) {
      return { canvas, paint, words: 'drawn by WebGL2', again: () => webglPainter(canvas, asset) };
    }
  }
  const canvas = newCanvas();
  return { canvas, paint: plainPainter(canvas, asset), words: 'drawn by plain script', again: null };
}
