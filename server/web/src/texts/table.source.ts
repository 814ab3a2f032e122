/** In place of `table` where the page is not built, in tests and the development server: with a parser. */
import { compileMessage } from "@lingui/message-utils/compileMessage";
import { isSimple } from "./simple";
import { table as texts } from "../texts/table";

export type { Key } from "../texts/table";
export const table = Object.fromEntries(
  Object.entries(texts).map(([key, text]) => [
    key,
    typeof text === "string" && !isSimple(text) ? compileMessage(text) : text,
  ]),
) as typeof texts;
