// Bundles what the page takes from others, and writes down what it is: name, version, licence, sha256.
// Run by `make vendor`. The same packages give the same bytes.
import { createHash } from "node:crypto";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, "../../src/armcontour/report/static/vendor");
const LIBRARIES = [
  { name: "three", files: ["three.js"] },
  { name: "uplot", files: ["uplot.js", "uplot.css"] },
  ...["preact", "@preact/signals", "@preact/signals-core", "htm"].map((name) => ({ name, files: ["preact.js"] })),
];
const BUNDLES = [...new Set(LIBRARIES.map(({ files }) => files[0]))];

mkdirSync(out, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: BUNDLES,
  outdir: out,
  bundle: true,
  format: "esm",
  minify: true,
  target: "es2022",
  // The licences stand in LICENSES.txt.
  legalComments: "none",
});
// What a bundle exports are its types too, of which `make check` finds the packages.
for (const file of BUNDLES) copyFileSync(join(here, file), join(out, file.replace(/js$/, "d.ts")));
copyFileSync(join(here, "node_modules/uplot/dist/uPlot.min.css"), join(out, "uplot.css"));

const licences = [];
const record = LIBRARIES.map(({ name, files }) => {
  const folder = join(here, "node_modules", name);
  const { version, license, homepage } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const text = readFileSync(join(folder, "LICENSE"), "utf8").trim();
  licences.push(`${name} ${version} (${files.join(", ")})\n${homepage}\n\n${text}\n`);
  return {
    name,
    version,
    licence: license,
    files: files.map((file) => ({ file, sha256: createHash("sha256").update(readFileSync(join(out, file))).digest("hex") })),
  };
});
writeFileSync(join(out, "VENDOR.json"), `${JSON.stringify(record, null, 2)}\n`);
writeFileSync(join(out, "LICENSES.txt"), licences.join(`\n${"-".repeat(80)}\n\n`));
