// The lights: on the sphere, by error or leverage, and in a table with picture and bake of each.

/** Joins what the report says of each light to the lights of the page. */
function joinLights() {
  const { lights } = details;
  const fitted = lights.filter((light) => light.fitted);
  const left = lights.filter((light) => !light.fitted);
  const judges = report.holdout?.pictures ?? [];
  if (isSweep()) {
    const errors = new Map((shownChoice()?.lights ?? []).map((light) => [light.name, light.rmse]));
    (left.length > 0 ? left : fitted).forEach((light) => { light.error = errors.get(light.name) ?? null; });
  } else {
    fitted.forEach((light, i) => {
      light.fit = report.lights[i]?.fit_rmse ?? null;
      light.error = judges.length > 0 ? null : report.lights[i]?.leave_one_out_rmse ?? null;
      light.predicted = report.lights[i]?.leave_one_out_rmse ?? null;
      light.misfit = report.lights[i]?.misfit === true;
    });
    left.forEach((light, i) => { light.error = judges[i]?.rmse ?? null; });
  }
  lights.forEach((light, index) => { light.index = index; });
  details.pictureOf = new Map(details.pictures.list);
}

const SPHERE = 100;

/** The rim of the sphere's disc in radians from straight up: the horizon, or straight down for lights all around. */
function rimOf(lights) {
  return lights.some((light) => light.direction[2] < -0.02) ? Math.PI : Math.PI / 2;
}

function showSphere() {
  const rim = rimOf(details.lights);
  const place = (direction) => discFromDirection(direction, rim).map((value, i) => value * SPHERE * (i === 1 ? -1 : 1));
  const drawing = svg('svg', { viewBox: '-112 -112 224 224', tabindex: 0, role: 'img', 'aria-label': 'lights seen from above; arrow keys turn the live light' });
  drawing.append(svg('circle', { class: 'dome', r: SPHERE }));
  const rings = rim > 2 ? [60, 30, 0, -30, -60] : [60, 30];
  for (const elevation of rings) {
    const radius = ((90 - elevation) / degrees(rim)) * SPHERE;
    drawing.append(svg('circle', { class: 'ring', r: radius }), svg('text', { x: 2, y: -radius + 6 }, `${elevation}°`));
  }
  drawing.append(svg('text', { y: -103, 'text-anchor': 'middle' }, 'up'), svg('text', { y: -103, transform: 'rotate(90)', 'text-anchor': 'middle' }, 'right'));
  const { gap, basis, lights } = details;
  if (gap) {
    const around = circleAround(gap.centre, (gap.degrees * Math.PI) / 180).map(place);
    drawing.append(svg('clipPath', { id: 'dome' }, svg('circle', { r: SPHERE })));
    drawing.append(svg('path', { class: 'gap', 'clip-path': 'url(#dome)', d: `M${around.map((at) => at.map((v) => v.toFixed(1)).join(' ')).join('L')}Z` },
      svg('title', {}, `largest gap between lights: ${gap.degrees.toFixed(1)}° to the nearest`)));
  }
  for (const centre of basis.centres ?? []) {
    const [x, y] = place(centre);
    if (Math.hypot(x, y) <= SPHERE + 8) {
      drawing.append(svg('path', { class: 'centre', d: `M${x - 2} ${y}h4M${x} ${y - 2}v4` }));
    }
  }
  const marks = lights.map((light) => {
    const [cx, cy] = place(light.direction);
    const mark = svg('circle', { class: light.fitted ? 'light' : 'light left-out', cx, cy, r: 3.4 }, svg('title', {}));
    drawing.append(mark);
    return mark;
  });
  const chosen = svg('circle', { class: 'chosen', r: 6 });
  const live = svg('circle', { class: 'live', r: 4.5 });
  drawing.append(chosen, live);
  byId('sphere').append(drawing);

  const scales = [
    { name: 'error', of: (light) => light.error, words: 'RMSE of judged lights' },
    { name: 'fit', of: (light) => light.fit, words: 'RMSE of the fit' },
    { name: 'leverage', of: (light) => light.leverage, words: 'leverage: how much of a picture only its own light says' },
  ].filter((scale) => lights.some((light) => isNumber(scale.of(light))));
  const select = byId('sphere-colors');
  select.append(...scales.map((scale) => element('option', { value: scale.name }, scale.name)));
  const paint = () => {
    const scale = scales.find((one) => one.name === select.value);
    const known = scale ? lights.map(scale.of).filter(isNumber) : [];
    const [least, most] = [Math.min(...known), Math.max(...known)];
    lights.forEach((light, i) => {
      const value = scale ? scale.of(light) : null;
      marks[i].setAttribute('fill', isNumber(value) ? rampColor((value - least) / (most - least || 1)) : 'transparent');
      marks[i].firstChild.textContent = `${light.name}: ${angleWords(light.direction)}, error ${fixed(light.error, 4)}, leverage ${fixed(light.leverage, 3)}`;
    });
    byId('sphere-legend').replaceChildren(...(scale ? [legend(fixed(least, 4), fixed(most, 4), scale.words)] : []));
  };
  select.addEventListener('change', paint);
  paint();

  const words = [`${lights.filter((light) => light.fitted).length} fitted lights${lights.some((light) => !light.fitted) ? ', left-out ones with a broken rim' : ''}`];
  if (gap) {
    words.push(`the largest gap (broken line) is ${gap.degrees.toFixed(1)}° to the nearest light`);
  }
  words.push(isNumber(details.condition) ? `condition number ${details.condition.toPrecision(3)}` : 'planes that are learned have no condition number');
  if (basis.centres) {
    words.push(`crosses are the ${basis.centres.length} centres of the functions`);
  }
  byId('sphere-text').textContent = `${words.join('; ')}. The yellow mark is the live light; click a light to take it.`;

  const toDisc = (x, y) => [((x - 0.5) * 224) / SPHERE, (-(y - 0.5) * 224) / SPHERE];
  onPointer(drawing, {
    drag: (x, y) => turnTo(directionFromDisc(...toDisc(x, y), rim)),
    click: (x, y) => {
      const at = directionFromDisc(...toDisc(x, y), rim);
      const nearest = lights.reduce((best, light) => (angleBetween(light.direction, at) < angleBetween(best.direction, at) ? light : best));
      if (angleBetween(nearest.direction, at) < 0.12) {
        choose(nearest.index);
      } else {
        turnTo(at);
      }
    },
  });
  drawing.addEventListener('dblclick', () => turnTo([0, 0, 1]));
  drawing.addEventListener('keydown', (event) => {
    const [azimuth, elevation] = anglesOf(state.direction);
    const turns = { ArrowLeft: [5, 0], ArrowRight: [-5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] };
    const turn = turns[event.key];
    if (turn) {
      event.preventDefault();
      turnTo(directionOf(azimuth + turn[0], Math.min(Math.max(elevation + turn[1], rim > 2 ? -90 : 0), 90)));
    }
  });
  const move = (mark, direction) => {
    const [cx, cy] = place(direction);
    mark.setAttribute('cx', cx);
    mark.setAttribute('cy', cy);
  };
  whenever('direction', () => move(live, state.direction));
  whenever('light', () => move(chosen, lights[state.light].direction));
}

/** Directions at `radius` around `centre`. */
function circleAround(centre, radius) {
  const aside = Math.abs(centre[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const u = unit(cross(centre, aside));
  const v = cross(centre, u);
  return Array.from({ length: 60 }, (_, i) => {
    const turn = (2 * Math.PI * i) / 60;
    return centre.map((c, j) => Math.cos(radius) * c + Math.sin(radius) * (Math.cos(turn) * u[j] + Math.sin(turn) * v[j]));
  });
}

/** Pixels along a small picture of the table. */
const THUMBNAIL = 72;

/** The bake under a light, small, drawn once it is seen. */
function thumbnail(light) {
  const { asset } = details;
  const step = Math.max(1, Math.floor(Math.max(asset.width, asset.height) / THUMBNAIL));
  const canvas = element('canvas', {
    width: Math.ceil(asset.width / step),
    height: Math.ceil(asset.height / step),
    role: 'img',
    'aria-label': `bake under ${light.name}`,
  });
  new IntersectionObserver((entries, observer) => {
    if (entries.some((entry) => entry.isIntersecting)) {
      observer.disconnect();
      canvas.getContext('2d').putImageData(asset.relit(light.direction, step), 0, 0);
    }
  }).observe(canvas);
  return canvas;
}

function showErrors() {
  const judged = details.lights.filter((light) => light.error !== undefined && (light.error !== null || light.fitted));
  const rows = judged.some((light) => !light.fitted) ? judged.filter((light) => !light.fitted) : judged;
  byId('errors').hidden = false;
  const known = rows.filter((light) => isNumber(light.error));
  const worst = known.reduce((a, b) => (b.error > a.error ? b : a), known[0]);
  const mean = known.reduce((sum, light) => sum + light.error, 0) / (known.length || 1);
  const how = rows.some((light) => !light.fitted) ? 'pictures that were left out' : 'each light as the others predict it';
  const every = details.pictures.every > 1 ? ` Every ${details.pictures.every}th picture is in the page.` : '';
  byId('errors-text').textContent = `Judged by ${how}: mean RMSE ${fixed(mean, 4)}${worst ? `, the worst ${worst.name} with ${fixed(worst.error, 4)}` : ''}. A click takes the light everywhere on the page.${every}`;
  const number = (title, key, decimals, extra = {}) => ({
    title,
    key: (row) => row[key],
    text: (row) => fixed(row[key], decimals),
    descending: true,
    ...extra,
  });
  const picture = (row) => {
    const uri = details.pictureOf.get(row.index);
    return uri ? element('img', { src: uri, alt: `picture under ${row.name}`, loading: 'lazy' }) : '–';
  };
  const error = number('RMSE', 'error', 4);
  const columns = [
    { title: 'light', key: (row) => row.index, text: (row) => element('button', { type: 'button', click: () => choose(row.index) }, row.name), class: 'words' },
    { title: 'from', text: (row) => angleWords(row.direction), class: 'wide' },
    error,
    { title: 'dB', text: (row) => fixed(decibels(row.error), 2), key: (row) => decibels(row.error) },
    number('fit', 'fit', 4, { class: 'wide' }),
    number('leverage', 'leverage', 3, { class: 'wide' }),
    { title: 'picture', text: picture },
    { title: 'bake', text: thumbnail },
  ].filter((column) => column.title !== 'fit' || rows.some((row) => isNumber(row.fit)))
    .filter((column) => column.title !== 'leverage' || rows.some((row) => isNumber(row.leverage)));
  const { node, lines } = table(columns, rows, { pick: (row) => choose(row.index) });
  byId('errors-table').append(node);
  whenever('light', () => lines.forEach(({ row, line }) => line.classList.toggle('chosen', row.index === state.light)));
}
