import { compileMessage } from "@lingui/message-utils/compileMessage";
import { defineConfig, type Plugin } from "vite";
import { fingerprint } from "./scripts/fingerprint.mjs";
import { isSimple } from "./src/texts/simple.ts";

/** Leaves `sources.json` beside what was built. */
function sources(): Plugin {
  return {
    name: "sources",
    apply: "build",
    generateBundle() {
      const source = JSON.stringify({ sha256: fingerprint(".") }) + "\n";
      this.emitFile({ type: "asset", fileName: "sources.json", source });
    },
  };
}

/** Texts with plurals or quotes are parsed here, so that the page needs no parser. */
function messages(): Plugin {
  return {
    name: "messages",
    apply: "build",
    transform(code, id) {
      if (!/\/texts\/[a-z]{2}\.ts$/.test(id)) return null;
      const said: [number, number, string][] = [];
      for (const node of this.parse(code).body) {
        if (node.type !== "ExportNamedDeclaration" || node.declaration?.type !== "VariableDeclaration") continue;
        const table = node.declaration.declarations[0]?.init;
        if (table?.type !== "ObjectExpression") throw new Error(`${id}: a table of texts is an object`);
        for (const entry of table.properties) {
          const text = entry.type === "Property" && entry.value.type === "Literal" ? entry.value.value : null;
          if (entry.type !== "Property" || typeof text !== "string") throw new Error(`${id}: a text is a string`);
          if (!isSimple(text)) said.push([entry.value.start, entry.value.end, JSON.stringify(compileMessage(text))]);
        }
      }
      for (const [start, end, text] of said.reverse()) code = code.slice(0, start) + text + code.slice(end);
      return { code, map: null };
    },
  };
}

/** Chunks of texts. Their names hold no hash, so that a text that changes renames no file that loads it. */
const TEXTS = ["said_de", "words"];

// What is built is package data of the server and is committed: a site needs no Node.
export default defineConfig(({ command }) => ({
  base: "./",
  plugins: [sources(), messages()],
  resolve: command === "build" ? {} : { alias: [{ find: "./table", replacement: "./table.source" }] },
  build: {
    outDir: "dist",
    emptyOutDir: true,
    target: ["es2020", "safari15", "firefox90", "chrome90"],
    modulePreload: { polyfill: false }, // it would be an inline script, which the policy refuses
    assetsInlineLimit: 0,
    reportCompressedSize: true,
    rollupOptions: {
      output: {
        entryFileNames: "assets/page-[hash].js",
        chunkFileNames: ({ name }) => (TEXTS.includes(name) ? "texts/[name].js" : "assets/[name]-[hash].js"),
        codeSplitting: { groups: [{ name: "words", test: /src\/texts\/(en|de)\.ts$/ }] },
        assetFileNames: "assets/[name]-[hash][extname]",
      },
    },
  },
  server: { proxy: { "/api": { target: "http://127.0.0.1:8350", ws: true, changeOrigin: true } } },
}));
