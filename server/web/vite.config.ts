import { defineConfig, type Plugin } from "vite";
import { fingerprint } from "./scripts/fingerprint.mjs";

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

// What is built is package data of the server and is committed: a site needs no Node.
export default defineConfig({
  base: "./",
  plugins: [sources()],
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
        chunkFileNames: "assets/[name]-[hash].js",
        assetFileNames: "assets/[name]-[hash][extname]",
      },
    },
  },
  server: { proxy: { "/api": { target: "http://127.0.0.1:8350", ws: true, changeOrigin: true } } },
});
