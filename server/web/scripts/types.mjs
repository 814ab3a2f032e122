// Types of the REST interface and of report.json, and what a report says in German, each with the hash of its source.
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { readFileSync, rmSync, writeFileSync } from "node:fs";

/** Writes what was made of a source; the first line names that file. */
function write(target, source, content) {
  const digest = createHash("sha256")
    .update(readFileSync(`../../${source}`))
    .digest("hex");
  writeFileSync(target, `// ${source} sha256 ${digest}\n${content}`);
}

/** Types of an OpenAPI description. */
function make(description, target, source, options = []) {
  execFileSync("openapi-typescript", [description, "-o", target, ...options], { stdio: "inherit" });
  write(target, source, readFileSync(target, "utf8"));
}

/** A JSON schema as components of a description: keys of later versions are nothing that the page could name. */
function componentsOf(file) {
  const { $defs, ...root } = JSON.parse(
    readFileSync(file, "utf8").replaceAll("#/$defs/", "#/components/schemas/"),
    (key, value) => (key === "additionalProperties" && value === true ? undefined : value),
  );
  const schemas = { ...$defs, [root.title]: root };
  return JSON.stringify({
    openapi: "3.1.0",
    info: { title: root.title, version: "1" },
    paths: {},
    components: { schemas },
  });
}

make("../../docs/openapi.json", "src/net/api.gen.ts", "docs/openapi.json");
const components = "report.components.json";
writeFileSync(components, componentsOf("../../docs/report.schema.json"));
try {
  // A key with a default may be missing in a report of an earlier version.
  make(components, "src/views/results/report.gen.ts", "docs/report.schema.json", ["--default-non-nullable=false"]);
} finally {
  rmSync(components);
}

// `report.html` reads the same file; texts of its own (`page`) are nothing that a report holds.
const german = "fitting/report/languages/german.json";
const groups = Object.values(JSON.parse(readFileSync(`../../${german}`, "utf8")).report);
const table = JSON.stringify(Object.assign({}, ...groups), null, 2);
write("src/texts/report_de.gen.ts", german, `export const REPORT: Record<string, string> = ${table};\n`);
