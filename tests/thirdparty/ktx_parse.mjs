// Reads KTX2 files of ours with npm's ktx-parse: keys, sizes, and the document that says what layers hold.
import { readFileSync } from 'node:fs';
import { basename } from 'node:path';
import { read } from 'ktx-parse';

const text = (value) => (typeof value === 'string' ? value : new TextDecoder().decode(value)).replace(/\0$/, '');
const fail = (file, words) => { throw new Error(`${file}: ${words}`); };
let assets = 0;
let parts = 0;
for (const file of process.argv.slice(2)) {
  const container = read(readFileSync(file));
  const keys = container.keyValue;
  if (text(keys.KTXorientation) !== 'rd') fail(file, 'orientation');
  if (!text(keys.KTXwriter).startsWith('relight ')) fail(file, 'writer');
  const document = JSON.parse(text(keys.relight));
  if (container.levels.some((level) => level.levelData.byteLength === 0)) fail(file, 'an empty level');
  if (document.part_of !== undefined) {
    if (document.part_of.endsWith('.ktx2') && /^[0-9a-f]{16}$/.test(document.id)) parts += 1;
    else fail(file, 'part');
    continue;
  }
  const [first] = document.arrays;
  const split = first.files !== undefined && first.files.length === first.layers.length && container.layerCount === 0;
  if (!split && container.layerCount !== first.layers.length) fail(file, `${container.layerCount} layers`);
  if (container.levels.length !== document.levels) fail(file, `${container.levels.length} levels`);
  const planes = document.arrays.flatMap((array) => array.layers.flatMap((layer) => {
    if (layer.scale.length !== layer.planes.length || layer.bias.length !== layer.planes.length) fail(file, 'layer');
    return layer.planes;
  }));
  planes.sort((a, b) => a - b);
  if (planes.some((plane, i) => plane !== i)) fail(file, `planes ${planes}`);
  if (first.files !== undefined && first.files[0] !== basename(file)) fail(file, `files ${first.files}`);
  assets += 1;
}
console.log(`thirdparty: ktx-parse reads the keys of ${assets} assets and ${parts} further files`);
