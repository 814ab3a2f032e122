// Types of the REST interface and of report.json: made of files that the service and its reports have, before the page is
// checked, tested or built, and kept by nobody.
import { execFileSync } from "node:child_process";
import { readFileSync, rmSync, writeFileSync } from "node:fs";

/** Types of an OpenAPI description. */
function make(description, target, options = []) {
  execFileSync("openapi-typescript", [description, "-o", target, ...options], { stdio: "inherit" });
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

make("../../docs/openapi.json", "src/net/api.gen.ts");
const components = "report.components.json";
writeFileSync(components, componentsOf("../../docs/report.schema.json"));
try {
  // A key with a default may be missing in a report of an earlier version.
  make(components, "src/views/results/report.gen.ts", ["--default-non-nullable=false"]);
} finally {
  rmSync(components);
}
