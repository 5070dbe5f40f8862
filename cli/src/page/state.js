// What is looked at: a live light, one of the lights of the capture, and a pixel; and who wants to know.

const data = JSON.parse(byId('data').textContent);
const { report, details } = data;

const state = {
  /** The live light. */
  direction: [0, 0, 1],
  /** Index of the light whose picture is beside the bake. */
  light: 0,
  pixel: [0, 0],
};

const listeners = { direction: [], light: [], pixel: [] };

/** Calls `listener` when `what` changes. */
function whenever(what, listener) {
  listeners[what].push(listener);
}

function tell(what) {
  listeners[what].forEach((listener) => listener());
}

/** What does `work` before the next frame, however often it is called until then. */
function oncePerFrame(work) {
  let asked = false;
  return () => {
    if (!asked) {
      asked = true;
      requestAnimationFrame(() => {
        asked = false;
        work();
      });
    }
  };
}

function unit(vector) {
  const length = Math.hypot(...vector);
  return vector.map((value) => value / length);
}

/** Turns the live light, as far as the capture knows. */
function turnTo(direction) {
  state.direction = details.asset.known(unit(direction));
  tell('direction');
}

/** Takes light `index` of the capture: its picture, and its direction for the live light. */
function choose(index) {
  const { lights } = details;
  state.light = Math.min(Math.max(index, 0), lights.length - 1);
  tell('light');
  turnTo(lights[state.light].direction);
}

function inspect(x, y) {
  const clamp = (value, most) => Math.min(Math.max(Math.floor(value), 0), most - 1);
  state.pixel = [clamp(x, details.width), clamp(y, details.height)];
  tell('pixel');
}

const degrees = (radians) => (radians * 180) / Math.PI;

/** Azimuth, counter-clockwise from the right, and elevation above the picture, in degrees. */
function anglesOf([x, y, z]) {
  return [degrees(Math.atan2(y, x)), degrees(Math.atan2(z, Math.hypot(x, y)))];
}

function directionOf(azimuth, elevation) {
  const [a, e] = [azimuth, elevation].map((angle) => (angle * Math.PI) / 180);
  return [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
}

const angleWords = (direction) => {
  const [azimuth, elevation] = anglesOf(direction);
  return `${azimuth.toFixed(0)}°, ${elevation.toFixed(0)}° up`;
};

/** Where a direction lies on a disc seen from above, -1 to 1; the rim is `rim` radians from straight up. */
function discFromDirection([x, y, z], rim) {
  const flat = Math.hypot(x, y);
  const radius = Math.atan2(flat, z) / rim;
  return flat > 0 ? [(radius * x) / flat, (radius * y) / flat] : [0, radius];
}

function directionFromDisc(x, y, rim) {
  const radius = Math.hypot(x, y);
  const angle = Math.min(radius, 1) * rim;
  const flat = radius > 0 ? Math.sin(angle) / radius : 0;
  return [x * flat, y * flat, Math.cos(angle)];
}
