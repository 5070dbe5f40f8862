// The live picture, and the slider between a picture and its bake.

/** Below so many pixels along its longer side a picture is shown with hard pixels. */
const COARSE = 160;

function markCoarse(stage) {
  stage.classList.toggle('coarse', Math.max(details.width, details.height) < COARSE);
}

function crosshair() {
  const { width, height } = details;
  const length = Math.max(width, height) / 30;
  const lines = ['#000', '#fff'].map((stroke, i) => svg('path', { stroke, 'stroke-width': (length / 6) * (2 - i), fill: 'none' }));
  const overlay = svg('svg', { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: 'none' }, ...lines);
  whenever('pixel', () => {
    const [x, y] = state.pixel.map((value) => value + 0.5);
    const d = `M${x - length} ${y}h${length * 0.7}M${x + length * 0.3} ${y}h${length * 0.7}M${x} ${y - length}v${length * 0.7}M${x} ${y + length * 0.3}v${length * 0.7}`;
    lines.forEach((line) => line.setAttribute('d', d));
  });
  return overlay;
}

function showPanel() {
  const { asset } = details;
  const stage = byId('panel');
  const painter = painterOf(asset);
  const { canvas } = painter;
  canvas.id = 'live-picture';
  canvas.setAttribute('role', 'img');
  canvas.setAttribute('aria-label', 'the asset under the live light');
  stage.append(canvas, crosshair());
  markCoarse(stage);
  const paint = oncePerFrame(() => painter.paint?.(state.direction));
  canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => {
    painter.paint = painter.again();
    paint();
  });
  const size = details.factor > 1 ? ` Each of its pixels is the mean of ${details.factor} x ${details.factor} of the asset's ${details.whole.join(' x ')}.` : '';
  byId('painter').textContent = `${details.name}, ${asset.width} x ${asset.height} pixels, ${painter.words}.${size}`;
  // The picture as a dome seen from above: its inscribed circle is the horizon.
  const onDome = (x, y) => {
    const least = Math.min(asset.width, asset.height) / 2;
    const [u, v] = [((x - 0.5) * asset.width) / least, (-(y - 0.5) * asset.height) / least];
    const radius = Math.max(Math.hypot(u, v), 1);
    return [u / radius, v / radius, Math.sqrt(Math.max(1 - (u * u + v * v) / radius ** 2, 0))];
  };
  onPointer(stage, {
    drag: (x, y) => turnTo(onDome(x, y)),
    click: (x, y) => inspect(x * asset.width, y * asset.height),
  });
  stage.addEventListener('dblclick', () => turnTo([0, 0, 1]));
  const [azimuth, elevation] = [byId('azimuth'), byId('elevation')];
  const turn = () => turnTo(directionOf(azimuth.valueAsNumber, elevation.valueAsNumber));
  azimuth.addEventListener('input', turn);
  elevation.addEventListener('input', turn);
  whenever('direction', () => {
    const angles = anglesOf(state.direction);
    [azimuth, elevation].forEach((range, i) => {
      if (document.activeElement !== range) {
        range.value = angles[i];
      }
    });
    byId('azimuth-text').textContent = `${angles[0].toFixed(0)}°`;
    byId('elevation-text').textContent = `${angles[1].toFixed(0)}°`;
    byId('live').textContent = state.direction.map((value) => value.toFixed(3)).join(', ');
    paint();
  });
}

function showSlider() {
  const { asset, lights } = details;
  const stage = byId('slider');
  const canvas = element('canvas', { width: asset.width, height: asset.height, id: 'bake', role: 'img', 'aria-label': 'the bake under the chosen light' });
  const image = element('img', { id: 'picture', alt: 'the picture under the chosen light' });
  const handle = element('div', { class: 'handle', role: 'slider', tabindex: 0, 'aria-label': 'where picture ends and bake begins', 'aria-valuemin': 0, 'aria-valuemax': 100 });
  stage.append(canvas, image, crosshair(), element('span', { class: 'tag left' }, 'picture'), element('span', { class: 'tag right' }, 'bake'), handle);
  markCoarse(stage);
  let split = 50;
  const moveTo = (percent) => {
    split = Math.min(Math.max(percent, 0), 100);
    image.style.clipPath = `inset(0 ${100 - split}% 0 0)`;
    handle.style.left = `${split}%`;
    handle.setAttribute('aria-valuenow', split.toFixed(0));
    handle.setAttribute('aria-valuetext', `${split.toFixed(0)} % picture`);
  };
  moveTo(split);
  onPointer(stage, {
    drag: (x) => moveTo(100 * x),
    click: (x, y) => inspect(x * asset.width, y * asset.height),
  });
  handle.addEventListener('keydown', (event) => {
    const steps = { ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2, PageDown: -10, PageUp: 10, Home: -100, End: 100 };
    if (event.key in steps) {
      event.preventDefault();
      moveTo(split + steps[event.key]);
    }
  });
  const select = byId('light');
  select.append(...lights.map((light) => element('option', { value: light.index }, `${light.name}${light.fitted ? '' : ' (left out)'}`)));
  select.addEventListener('change', () => choose(Number(select.value)));
  byId('before').addEventListener('click', () => choose(state.light - 1));
  byId('after').addEventListener('click', () => choose(state.light + 1));
  whenever('light', () => {
    const light = lights[state.light];
    select.value = light.index;
    canvas.getContext('2d').putImageData(asset.relit(asset.known(light.direction)), 0, 0);
    const uri = details.pictureOf.get(light.index);
    image.hidden = !uri;
    if (uri) {
      image.src = uri;
    }
    const kept = uri ? `left the picture (JPEG of quality ${details.pictures.quality}), right the bake` : `this picture is not in the page, which has every ${details.pictures.every}th`;
    byId('slider-text').textContent = `${light.name}, ${angleWords(light.direction)}, error ${fixed(light.error, 4)}: ${kept}. Drag, or move the handle by arrow keys.`;
  });
}
