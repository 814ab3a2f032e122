// What the built page was made of, so that a test without Node can say when it is out of date.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync } from "node:fs";
import { join } from "node:path";

const ROOTS = ["src", "public"];
const FILES = [
  "index.html",
  "package-lock.json",
  "package.json",
  "scripts/types.mjs",
  "tsconfig.json",
  "vite.config.ts",
  // What types.mjs makes the rest of, and texts that Python has.
  "../../docs/openapi.json",
  "../../docs/report.schema.json",
  "../../daq/texts/de.json",
  "../../fitting/texts/de.json",
  "../../sim_backends/texts/de.json",
  "../texts/de.json",
];

/** SHA-256 over the names and contents of all sources but their tests and what is made of them, in the order of names. */
export function fingerprint(folder) {
  const hash = createHash("sha256");
  for (const name of [...ROOTS.flatMap((root) => walk(folder, root)), ...FILES].sort()) {
    hash
      .update(name)
      .update("\0")
      .update(readFileSync(join(folder, name)))
      .update("\0");
  }
  return hash.digest("hex");
}

function walk(folder, place) {
  return readdirSync(join(folder, place), { withFileTypes: true }).flatMap((entry) =>
    entry.isDirectory()
      ? walk(folder, `${place}/${entry.name}`)
      : [`${place}/${entry.name}`].filter((name) => !/\.(test|gen)\./.test(name)),
  );
}
