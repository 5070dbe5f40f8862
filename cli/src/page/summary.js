// What was baked, what other choices cost, and where errors come from: numbers alone, without the asset.

function isSweep() {
  return report.kind === 'sweep';
}

/** The choice of a sweep that the page shows. */
function shownChoice() {
  return isSweep() ? report.choices.find((choice) => choice.name === data.shown) : null;
}

function basisWords(basis) {
  switch (basis.family) {
    case 'ptm': return `ptm of degree ${basis.degree}`;
    case 'learned': return `${basis.origin} in ${basis.planes} planes, a table of ${basis.nodes} x ${basis.nodes} directions`;
    case 'srbf': return `srbf with ${basis.centres.length} centres, spread ${degrees(basis.spread).toFixed(1)}°, ${basis.kernel}`;
    default: return `${basis.family} of order ${basis.order}`;
  }
}

function bakeFacts() {
  const { storing } = report;
  const bytes = (storing.bits_per_pixel / 8) * report.width * report.height;
  return [
    ['asset', report.output],
    ['basis', `${basisWords(report.basis)}: ${report.functions} functions`],
    ['formats', `${storing.formats.join(', ')}, ${storing.layers} layers, ${storing.levels} mip levels`],
    ['texels', `${inBytes(Math.round(bytes))}, ${fixed(storing.bits_per_pixel, 2)} bits a pixel`],
    ['error of the fit', `${fixed(report.fit_rmse, 4)} on its own lights, ${fixed(report.leave_one_out_rmse, 4)} predicting each light from the others (rms, 0..1)`],
    ['error of storing', fixed(storing.relit_rmse, 4)],
    ['left-out pictures', report.holdout ? `${report.holdout.pictures.length}: PSNR ${fixed(report.holdout.mean.psnr, 2)} dB, RMSE ${fixed(report.holdout.mean.rmse, 4)}` : null],
    ['times', Object.entries(report.seconds).map(([stage, seconds]) => `${stage} ${fixed(seconds, 2)}`).join(', ') + ' s'],
  ];
}

function sweepFacts() {
  const shown = shownChoice();
  return [
    ['capture', report.input],
    ['choices', `${report.choices.length}, judged by ${report.judged_by}`],
    ['shown below', shown ? `${shown.name}: relight bake ${shown.options.join(' ')}` : null],
    ['its planes', shown ? `${shown.planes} of ${shown.formats.join(', ')}` : null],
    ['its texels', shown ? `${inBytes(shown.texel_bytes)}, ${fixed(shown.gpu_bytes_per_pixel, 2)} bytes a pixel; ${inBytes(shown.file_bytes)} on disk` : null],
    ['its errors', shown ? `PSNR ${fixed(shown.psnr, 2)} dB, RMSE ${fixed(shown.rmse, 4)}; of the fit ${fixed(shown.fit_rmse, 4)}, of storing ${fixed(shown.storing_rmse, 4)}` : null],
    ['cost', `${fixed(report.seconds, 1)} s for ${report.measured} choices measured in this run; ${fixed(report.seconds_alone, 1)} s one by one`],
    ['GPU', report.choices.find((choice) => choice.gpu)?.gpu.adapter],
  ];
}

function showHead() {
  const [subject, facts] = isSweep() ? [report.input, sweepFacts()] : [report.output, bakeFacts()];
  byId('title').textContent = `${isSweep() ? 'Sweep' : 'Bake'} of ${subject.split(/[\\/]/).filter(Boolean).pop() ?? subject}`;
  byId('verdict').textContent = report.why ?? '';
  facts.splice(1, 0, ['size', `${report.width} x ${report.height} pixels${isSweep() ? `, ${report.pictures} pictures` : ''}`]);
  facts.push(['machine', data.machine], ['command', data.command]);
  for (const [name, value] of facts) {
    if (value) {
      byId('facts').append(element('dt', {}, name), element('dd', { class: name === 'command' ? 'code' : null }, value));
    }
  }
  byId('made').textContent = `relight ${report.relight}. The numbers are in the JSON report beside this page.`;
  const notes = [...(report.notes ?? [])];
  if (isSweep() && !details) {
    notes.unshift('No asset was kept that could be shown: run the sweep with --keep front.');
  }
  if (report.near) {
    notes.unshift('The lamps stood near: the bake is relit here as from far away, so that the fall-off of the pictures is missing in it.');
  }
  if (notes.length > 0) {
    byId('notes').hidden = false;
    byId('notes-list').append(...notes.map((note) => element('li', {}, note)));
  }
}

function showCosts() {
  if (!isSweep()) {
    return;
  }
  byId('costs').hidden = false;
  const number = (title, key, decimals, extra = {}) => ({
    title,
    key: (row) => row[key],
    text: (row) => fixed(row[key], decimals),
    ...extra,
  });
  const fronts = (row) => ['bytes', 'time', 'bake'].filter((front) => row.front[front]);
  const psnr = number('dB', 'psnr', 2, { descending: true });
  const columns = [
    { title: 'choice', text: (row) => row.name, key: (row) => row.name },
    psnr,
    number('RMSE', 'rmse', 4, { class: 'wide' }),
    number('bytes/px', 'gpu_bytes_per_pixel', 2),
    number('on disk', 'disk_bytes_per_pixel', 2, { class: 'wide' }),
    number('bake s', 'bake_seconds', 2, { class: 'wide' }),
    number('ns/px', 'directional_ns', 1),
    number('point ns', 'point_ns', 1, { class: 'wide' }),
  ];
  if (report.choices.some((row) => row.gpu)) {
    const ns = (row) => row.gpu?.ns;
    columns.push({ title: 'GPU ns', key: ns, text: (row) => (row.gpu ? fixed(ns(row), 1) : '–'), class: 'wide' });
  }
  columns.push({ title: 'fronts', text: (row) => fronts(row).join(', ') || '–', key: (row) => -fronts(row).length, class: 'words' });
  const { node, lines } = table(columns, report.choices);
  lines.forEach(({ row, line }) => line.classList.toggle('chosen', row.name === data.shown));
  byId('choices').append(node);
}

/** Colours of stages, apart in both schemes. */
const STAGE_COLORS = ['#4477aa', '#ee6677', '#ccbb44', '#228833', '#aa3377', '#66ccee', '#888888'];

function showBudget() {
  const { budget } = data;
  if (!budget) {
    return;
  }
  byId('budget').hidden = false;
  const rms = (square) => Math.sqrt(Math.max(square, 0));
  const share = (stage) => (budget.total > 0 ? stage.adds / budget.total : 0);
  const worst = budget.worst_light ? ` The worst light is ${budget.worst_light[0]}, RMSE ${fixed(budget.worst_light[1], 4)}.` : '';
  byId('budget-text').textContent = `Mean squared errors add up stage by stage to ${budget.total.toExponential(3)}, RMSE ${fixed(rms(budget.total), 4)} (${fixed(decibels(rms(budget.total)), 2)} dB).${worst}${budget.gpu ? ` ${budget.gpu}.` : ''}`;
  const color = (index) => STAGE_COLORS[index % STAGE_COLORS.length];
  const added = budget.stages.reduce((sum, stage) => sum + Math.max(stage.adds, 0), 0) || 1;
  const stack = element('div', { class: 'stack', role: 'img', 'aria-label': 'what stages add to the error; the table has the numbers' });
  const key = element('div', { class: 'key' });
  budget.stages.forEach((stage, i) => {
    const words = `${stage.name} ${(100 * share(stage)).toFixed(1)} %`;
    if (stage.adds > 0) {
      stack.append(element('span', { title: words, style: `width:${(100 * stage.adds) / added}%;background:${color(i)}` }));
    }
    key.append(element('span', {}, element('i', { style: `background:${color(i)}` }), words));
  });
  // From where the stages before have come to where this one leads.
  let before = 0;
  const rows = budget.stages.map((stage) => {
    const from = before;
    before += stage.adds;
    return { ...stage, from, to: before };
  });
  const most = Math.max(...rows.map((row) => Math.max(row.from, row.to)), 1e-12);
  const bar = (row) => {
    const [low, high] = [Math.max(Math.min(row.from, row.to), 0), Math.max(row.from, row.to)];
    const style = `left:${(100 * low) / most}%;width:${(100 * (high - low)) / most}%`;
    return element('span', { class: 'bar' }, element('span', { class: row.adds < 0 ? 'less' : null, style }));
  };
  const columns = [
    { title: 'stage', text: (row) => row.name },
    { title: 'adds (MSE)', text: (row) => row.adds.toExponential(3) },
    { title: 'share', text: (row) => `${(100 * share(row)).toFixed(1)} %`, class: 'wide' },
    { title: 'RMSE after', text: (row) => fixed(rms(row.to), 4) },
    { title: 'from, to', text: bar, class: 'wide' },
  ];
  byId('budget-table').before(stack, key);
  byId('budget-table').append(table(columns, rows).node);
  const maps = budget.stages.filter((stage) => stage.map);
  byId('heat-maps').append(...maps.map((stage) => {
    const image = element('img', { src: stage.map, alt: `error of each pixel after ${stage.name}` });
    image.addEventListener('click', (event) => {
      if (details) {
        const box = image.getBoundingClientRect();
        inspect(((event.clientX - box.left) / box.width) * details.width, ((event.clientY - box.top) / box.height) * details.height);
      }
    });
    return element('figure', {}, element('figcaption', {}, `after ${stage.name}`), image);
  }));
  if (maps.length > 0) {
    const ticks = budget.legend.ticks.map(([label, place]) => element('span', { style: `left:${100 * place}%` }, label));
    byId('heat-legend').append(element('p', { class: 'hint' }, 'Root mean square error of a pixel over the lights, one scale for all maps:'),
      element('div', { class: 'heat' }, element('img', { src: budget.legend.image, alt: 'colours from 0.001 to 0.316' }), ...ticks));
  }
  const worstLight = details?.lights.find((light) => light.name === budget.worst_light?.[0]);
  if (worstLight) {
    byId('worst-pixels').append('worst light:', element('button', { type: 'button', click: () => choose(worstLight.index) }, worstLight.name));
  }
  if (budget.worst_pixels.length > 0) {
    byId('worst-pixels').append('worst pixels:', ...budget.worst_pixels.map(([x, y, rmse]) => element('button', {
      type: 'button',
      click: () => details && inspect(x / details.factor, y / details.factor),
    }, `${x}, ${y} (RMSE ${fixed(rmse, 3)})`)));
  }
}
