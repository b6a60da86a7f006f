// Bundles the part of plotly.js that reports use, and records its packages: name, version, licence, sha256.
// Run by `make vendor`. The same packages give the same bundle.
import { createHash } from "node:crypto";
import { mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, "../../../src/armcontour/report/vendor");
const LICENCE = /^(licen[cs]e|copying)/i;

const made = await build({
  absWorkingDir: here,
  entryPoints: ["plotly.cjs"],
  bundle: true,
  format: "iife",
  globalName: "Plotly",
  minify: true,
  target: "es2022",
  // The licences stand in LICENSES.txt.
  legalComments: "none",
  define: { global: "window", "define.amd": "false", "process.env.NODE_DEBUG": "false" },
  alias: { regl: "@plotly/regl" },
  // The only style sheet is that of maps.
  loader: { ".css": "empty", ".glsl": "text" },
  metafile: true,
  write: false,
});
const bundle = made.outputFiles[0].contents;
const inputs = Object.values(made.metafile.outputs)[0].inputs;
const folders = new Set(
  Object.keys(inputs)
    .filter((path) => inputs[path].bytesInOutput > 0 && /node_modules\/.*(?<!\.css)$/.test(path))
    .map((path) => path.replace(/^(.*node_modules\/(?:@[^/]+\/)?[^/]+).*$/, "$1")),
);

const packages = [...folders].map((path) => {
  const folder = join(here, path);
  const { name, version, license, homepage, author } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const file = readdirSync(folder).find((file) => LICENCE.test(file));
  const writer = typeof author === "object" ? author.name : author;
  const text = file ? readFileSync(join(folder, file), "utf8").replaceAll("\r\n", "\n").trim() : `${license} licence, ${writer ?? name}`;
  return { name, version, licence: license, homepage, text };
});
packages.sort((a, b) => (a.name < b.name ? -1 : a.name > b.name ? 1 : a.version < b.version ? -1 : 1));
const { version, license } = packages.find(({ name }) => name === "plotly.js");
const record = {
  name: "plotly.js",
  version,
  licence: license,
  file: "plotly.js.gz",
  sha256: createHash("sha256").update(bundle).digest("hex"),
  packages: packages.map(({ name, version, licence }) => ({ name, version, licence })),
};

mkdirSync(out, { recursive: true });
writeFileSync(join(out, "plotly.js.gz"), gzipSync(bundle, { level: 9 }));
writeFileSync(join(out, "VENDOR.json"), `${JSON.stringify(record, null, 2)}\n`);
// Parts of plotly.js without a package of their own.
const { dependencies } = JSON.parse(readFileSync(join(here, "node_modules/plotly.js/stackgl_modules/package.json"), "utf8"));
const head =
  `plotly.js contains code of these packages, under the MIT licence: ${Object.keys(dependencies).join(", ")}.\n` +
  "plotly_white.json is the template of that name of plotly.py, under the licence of plotly.js.";
writeFileSync(
  join(out, "LICENSES.txt"),
  `${head}\n\n${"-".repeat(80)}\n\n` + packages.map((x) => `${x.name} ${x.version}\n${x.homepage ?? ""}\n\n${x.text}\n`).join(`\n${"-".repeat(80)}\n\n`),
);
