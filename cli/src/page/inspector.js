// One pixel: its samples on the light sphere beside the function that was fitted to them.

const CHANNELS = [
  { name: 'luminance', of: ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b },
  { name: 'red', of: ([r]) => r },
  { name: 'green', of: ([, g]) => g },
  { name: 'blue', of: ([, , b]) => b },
];

/** Pictures as they were decoded, so that their pixels can be read. */
async function decodedPictures() {
  const decoded = [];
  for (const [index, uri] of details.pictures.list) {
    const image = new Image();
    image.src = uri;
    await image.decode();
    decoded.push({ index, image });
  }
  return decoded;
}

/** R, G, B, 0 to 1, of every picture at a pixel. */
function samplesAt(pictures, [x, y], canvas) {
  canvas.width = pictures.length;
  canvas.height = 1;
  const context = canvas.getContext('2d', { willReadFrequently: true });
  context.imageSmoothingEnabled = false;
  pictures.forEach(({ image }, i) => context.drawImage(image, x, y, 1, 1, i, 0, 1, 1));
  const codes = context.getImageData(0, 0, pictures.length, 1).data;
  return pictures.map(({ index }, i) => ({ index, value: [0, 1, 2].map((c) => codes[4 * i + c] / 255) }));
}

/** Pixels along the grid on which functions are drawn. */
const GRID = 64;

async function showInspector() {
  const { asset, lights } = details;
  const rim = rimOf(lights);
  const pictures = await decodedPictures();
  const reader = document.createElement('canvas');
  const channel = byId('channel');
  const names = asset.channels === 1 ? CHANNELS.slice(0, 1) : CHANNELS;
  channel.append(...names.map(({ name }) => element('option', {}, name)));
  const [inputX, inputY] = [byId('pixel-x'), byId('pixel-y')];
  inputX.max = asset.width - 1;
  inputY.max = asset.height - 1;
  const typed = () => inspect(inputX.valueAsNumber || 0, inputY.valueAsNumber || 0);
  inputX.addEventListener('change', typed);
  inputY.addEventListener('change', typed);

  const grid = [];
  for (let i = 0; i < GRID * GRID; i++) {
    const [u, v] = [(2 * ((i % GRID) + 0.5)) / GRID - 1, 1 - (2 * (Math.floor(i / GRID) + 0.5)) / GRID];
    // A little beyond the rim, so that its edge is drawn whole.
    grid.push(Math.hypot(u, v) <= 1.1 ? asset.known(directionFromDisc(u, v, rim)) : null);
  }
  // Terms of the grid's directions are the same for all pixels.
  const terms = grid.map((direction) => (direction ? asset.weights(direction) : null));

  let points = [];
  const show = () => {
    const [x, y] = state.pixel;
    const of = CHANNELS.find(({ name }) => name === channel.value).of;
    inputX.value = x;
    inputY.value = y;
    const coefficients = asset.coefficients(x, y);
    const base = asset.baseAt(coefficients);
    const samples = samplesAt(pictures, state.pixel, reader);
    points = samples.map(({ index, value }) => ({
      light: lights[index],
      sample: of(value),
      fit: Math.max(of(asset.valueOf(asset.weights(asset.known(lights[index].direction)), coefficients, base)), 0),
    }));
    const fitted = terms.map((weights) => (weights ? Math.max(of(asset.valueOf(weights, coefficients, base)), 0) : null));
    const largest = Math.max(...points.map(({ sample, fit }) => Math.max(sample, fit)), 0.05);
    const most = Math.ceil(largest * 20) / 20;
    drawSamples(byId('samples'), points, rim, most);
    drawFunction(byId('function'), fitted, most);
    byId('pixel-legend').replaceChildren(legend('0', most.toFixed(2), `${channel.value}, encoded`));
    byId('pixel-plot').replaceChildren(plotByLight(points, most));
    showNumbers();
  };

  const showNumbers = () => {
    const [x, y] = state.pixel;
    const whole = details.factor > 1 ? `, of the asset about ${x * details.factor}, ${y * details.factor}` : '';
    byId('pixel-title').textContent = `Pixel ${x}, ${y}${whole}`;
    const codes = asset.value(asset.coefficients(x, y), state.direction).map(codeOf);
    const rms = Math.sqrt(points.reduce((sum, { sample, fit }) => sum + (sample - Math.min(fit, 1)) ** 2, 0) / (points.length || 1));
    const here = points.find(({ light }) => light.index === state.light);
    const sentences = [`Under the live light it is ${codes.slice(0, asset.channels === 1 ? 1 : 3).join(', ')} of 255.`];
    if (points.length > 0) {
      sentences.push(`Over ${points.length} lights the fit is off by ${rms.toFixed(4)} (rms, ${channel.value}).`);
    }
    if (here) {
      sentences.push(`${here.light.name}: sample ${here.sample.toFixed(3)}, fitted ${here.fit.toFixed(3)}.`);
    }
    const text = byId('pixel-text');
    text.textContent = sentences.join(' ');
    text.dataset.codes = codes.join(',');
  };
  const everything = oncePerFrame(show);
  ['pixel', 'light'].forEach((what) => whenever(what, everything));
  whenever('direction', oncePerFrame(showNumbers));
  channel.addEventListener('change', everything);
}

function clearedDisc(canvas) {
  const context = canvas.getContext('2d');
  const half = canvas.width / 2;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.translate(half, half);
  context.strokeStyle = '#8888';
  context.beginPath();
  context.arc(0, 0, half - 2, 0, 2 * Math.PI);
  context.stroke();
  return { context, radius: half - 2 };
}

function drawSamples(canvas, points, rim, most) {
  const { context, radius } = clearedDisc(canvas);
  for (const { light, sample } of points) {
    const [x, y] = discFromDirection(light.direction, rim);
    context.beginPath();
    context.arc(x * radius, -y * radius, 7, 0, 2 * Math.PI);
    context.fillStyle = rampColor(sample / most);
    context.fill();
    context.strokeStyle = light.index === state.light ? '#0b62a8' : '#8888';
    context.lineWidth = light.index === state.light ? 4 : 1;
    context.stroke();
  }
}

function drawFunction(canvas, fitted, most) {
  const { context, radius } = clearedDisc(canvas);
  const small = document.createElement('canvas');
  small.width = GRID;
  small.height = GRID;
  const picture = new ImageData(GRID, GRID);
  fitted.forEach((value, i) => {
    if (value !== null) {
      picture.data.set([...ramp(value / most), 255], 4 * i);
    }
  });
  small.getContext('2d').putImageData(picture, 0, 0);
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.save();
  context.clip();
  context.drawImage(small, -radius, -radius, 2 * radius, 2 * radius);
  context.restore();
}

/** Samples (rings) and fitted values (dots) by light, in the order of the capture. */
function plotByLight(points, most) {
  const [width, height, left, bottom] = [520, 180, 46, 10];
  const x = (i) => left + ((i + 0.5) * (width - left - 6)) / Math.max(points.length, 1);
  const y = (value) => 8 + (1 - Math.min(value / most, 1)) * (height - bottom - 8);
  const drawing = svg('svg', { viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': 'samples and fitted values of the pixel by light' });
  for (const value of [0, most / 2, most]) {
    drawing.append(svg('path', { class: 'grid', d: `M${left} ${y(value)}H${width}` }), svg('text', { x: left - 5, y: y(value) + 4, 'text-anchor': 'end' }, value.toFixed(2)));
  }
  points.forEach(({ light, sample, fit }, i) => {
    const title = svg('title', {}, `${light.name}: sample ${sample.toFixed(3)}, fitted ${fit.toFixed(3)}`);
    const mark = svg('g', { click: () => choose(light.index) }, title,
      svg('path', { class: light.index === state.light ? 'now' : 'stem', d: `M${x(i)} ${y(sample)}V${y(fit)}` }),
      svg('circle', { class: 'sample', cx: x(i), cy: y(sample), r: 3 }),
      svg('circle', { class: 'fit', cx: x(i), cy: y(fit), r: 2.2 }));
    drawing.append(mark);
  });
  const words = 'By light, in the order of the capture: rings are samples, dots what is fitted; a click takes the light.';
  return element('div', {}, drawing, element('p', { class: 'hint' }, words));
}
