// Elements of the page: text, tables, scales of colour, and pointers.

const byId = (id) => document.getElementById(id);

function make(maker, tag, attributes, children) {
  const made = maker(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') {
      made.addEventListener(name, value);
    } else if (value !== null && value !== undefined && value !== false) {
      made.setAttribute(name, value === true ? '' : value);
    }
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** An HTML element; attributes that are functions listen to the event of their name. */
function element(tag, attributes = {}, ...children) {
  return make((name) => document.createElement(name), tag, attributes, children);
}

function svg(tag, attributes = {}, ...children) {
  return make((name) => document.createElementNS('http://www.w3.org/2000/svg', name), tag, attributes, children);
}

const isNumber = (value) => typeof value === 'number' && Number.isFinite(value);

/** A number with `decimals`, or a dash where there is none. */
function fixed(value, decimals) {
  return isNumber(value) ? value.toFixed(decimals) : '–';
}

/** Thousands apart. */
function grouped(value) {
  return isNumber(value) ? Math.round(value).toLocaleString('en') : '–';
}

function inBytes(bytes) {
  const [unit, divisor] = bytes >= 2 ** 20 ? ['MiB', 2 ** 20] : bytes >= 1024 ? ['KiB', 1024] : ['bytes', 1];
  return divisor === 1 ? `${bytes} bytes` : `${(bytes / divisor).toFixed(1)} ${unit} (${grouped(bytes)} bytes)`;
}

/** PSNR in dB of a root mean square error, of a range of 1. */
function decibels(rmse) {
  return isNumber(rmse) && rmse > 0 ? -20 * Math.log10(rmse) : null;
}

/**
 * A table. `columns` have a `title`, `text` of a row (or an element), and what it is sorted by, `key`, where it can be;
 * `pick` is called with a row that is clicked.
 */
function table(columns, rows, { pick = null, sorted = null } = {}) {
  const body = element('tbody');
  const heads = columns.map((column) => {
    const head = element('th', { scope: 'col', class: column.class });
    if (column.key) {
      head.append(element('button', { type: 'button', click: () => sortBy(column) }, column.title));
    } else {
      head.append(column.title);
    }
    return head;
  });
  const lines = rows.map((row) => {
    const cells = columns.map((column) => element('td', { class: column.class }, column.text(row)));
    const line = element('tr', { class: pick ? 'pick' : null, click: pick ? () => pick(row) : null }, ...cells);
    return { row, line };
  });
  let descending = false;
  let by = null;
  function sortBy(column) {
    descending = by === column ? !descending : column.descending === true;
    by = column;
    const rank = ({ row }) => {
      const key = column.key(row);
      return key === null || key === undefined ? (descending ? -Infinity : Infinity) : key;
    };
    const ordered = [...lines].sort((a, b) => {
      const [p, q] = [rank(a), rank(b)];
      return (p < q ? -1 : p > q ? 1 : 0) * (descending ? -1 : 1);
    });
    body.replaceChildren(...ordered.map(({ line }) => line));
    columns.forEach((other, i) => {
      if (other === column) {
        heads[i].setAttribute('aria-sort', descending ? 'descending' : 'ascending');
      } else {
        heads[i].removeAttribute('aria-sort');
      }
    });
  }
  body.append(...lines.map(({ line }) => line));
  if (sorted) {
    sortBy(sorted);
  }
  const node = element('table', {}, element('thead', {}, element('tr', {}, ...heads)), body);
  return { node, lines };
}

/** Dark to bright, even to the eye and readable without colour vision (viridis). */
const RAMP = [[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]];

/** The colour at 0 to 1 as [r, g, b]. */
function ramp(value) {
  const at = Math.min(Math.max(value, 0), 1) * (RAMP.length - 1);
  const stop = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[stop].map((from, c) => Math.round(from + (RAMP[stop + 1][c] - from) * (at - stop)));
}

const rampColor = (value) => `rgb(${ramp(value).join(' ')})`;

/** The ramp with words at its ends. */
function legend(least, most, label) {
  const canvas = element('canvas', { width: 256, height: 1, role: 'img', 'aria-label': `${label}: from ${least} to ${most}` });
  const context = canvas.getContext('2d');
  for (let x = 0; x < 256; x++) {
    context.fillStyle = rampColor(x / 255);
    context.fillRect(x, 0, 1, 1);
  }
  return element('div', { class: 'legend' }, element('span', {}, least), canvas, element('span', {}, `${most} ${label}`));
}

/** Pixels that a pointer may move within a click. */
const CLICK = 4;

/**
 * Tells drags from clicks of mouse, finger or pen on `target`: `drag` and `click` get the place within it, 0 to 1 from its
 * left and top.
 */
function onPointer(target, { drag, click }) {
  let start = null;
  let moved = false;
  const place = (event) => {
    const box = target.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  target.addEventListener('pointerdown', (event) => {
    if (event.button !== 0) {
      return;
    }
    start = [event.clientX, event.clientY];
    moved = false;
    target.setPointerCapture(event.pointerId);
  });
  target.addEventListener('pointermove', (event) => {
    if (!start) {
      return;
    }
    moved ||= Math.hypot(event.clientX - start[0], event.clientY - start[1]) >= CLICK;
    if (moved) {
      drag(...place(event));
    }
  });
  target.addEventListener('pointerup', (event) => {
    if (start && !moved) {
      click(...place(event));
    }
    start = null;
  });
  target.addEventListener('pointercancel', () => { start = null; });
}
