// One rule: what a person reads is in the tables of `src/texts`, one per language. Types and style are `tsc`'s and prettier's.
import parser from "@typescript-eslint/parser";
import i18next from "eslint-plugin-i18next";

const message = "put this text into src/texts/en.ts and de.ts, and write t(key) here";
/** No letters, a lone letter (a mark, an axis), a unit, or our name. */
const NO_WORDS = [/^[^\p{L}]*\p{L}?[^\p{L}]*$/u, /^\s*(s|ms|Hz|kB|MB|mm|min|h|d|Nm?)\s*$/, /^hilfit$/];
/** Names and codes that programs read: no space in them, and not one capital word; addresses; lists of CSS. */
const CODE = [
  /^(?![A-Z][a-z]+$)\S*$/,
  /^(Escape|Location|Parquet|Bearer|– hilfit)$/,
  /^(\d+px|pan-y) .*$/,
  /^[#/&(].*$/,
  /^M?[\d.,\s]*[MLHVCSQTAZmlhvcsqtaz][\d.,\s-].*$/,
];

export default [
  {
    files: ["src/**/*.{ts,tsx}"],
    ignores: ["src/**/*.test.*", "src/views/fakes.tsx", "src/net/api.gen.ts", "src/texts/**"],
    languageOptions: { parser, parserOptions: { ecmaFeatures: { jsx: true } } },
    plugins: { markup: i18next, code: i18next },
    rules: {
      // Whatever stands between tags.
      "markup/no-literal-string": [
        "error",
        { mode: "jsx-text-only", message, words: { exclude: NO_WORDS }, "jsx-components": { exclude: ["code"] } },
      ],
      // Every other string and template that reads like words.
      "code/no-literal-string": [
        "error",
        {
          mode: "all",
          "should-validate-template": true,
          message,
          words: { exclude: [...NO_WORDS, ...CODE] },
          "jsx-attributes": { exclude: ["class", "d", "viewBox"] },
          // Why a connection was given up is for who looks for a fault with the browser's tools.
          callees: {
            exclude: ["Error", "matchMedia", "lost", "watch", "woke", "renew", "this\\.(lost|watch)", ".*\\.renew"],
          },
        },
      ],
    },
  },
];
