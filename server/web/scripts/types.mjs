// Types of the REST interface, with the hash of the description that they were made of.
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";

const [description, target] = ["../../docs/openapi.json", "src/net/api.gen.ts"];
execFileSync("openapi-typescript", [description, "-o", target], { stdio: "inherit" });
const digest = createHash("sha256").update(readFileSync(description)).digest("hex");
writeFileSync(target, `// docs/openapi.json sha256 ${digest}\n${readFileSync(target, "utf8")}`);
