// Types of the REST interface and of report.json, each with the hash of the description that it was made of.
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { readFileSync, rmSync, writeFileSync } from "node:fs";

/** Types of an OpenAPI description; the first line names the file that it comes from. */
function make(description, target, source, options = []) {
  execFileSync("openapi-typescript", [description, "-o", target, ...options], { stdio: "inherit" });
  const digest = createHash("sha256")
    .update(readFileSync(`../../${source}`))
    .digest("hex");
  writeFileSync(target, `// ${source} sha256 ${digest}\n${readFileSync(target, "utf8")}`);
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
