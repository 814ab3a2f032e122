/** The table of the language shown. Texts with plurals are parsed already where the page is built. */
import type { CompiledMessage } from "@lingui/message-utils/compileMessage";
import { de } from "./de";
import { en } from "./en";
import { language } from "./language";

/** The key of a text; one that is in no table does not compile. */
export type Key = keyof typeof en;
export const table: Record<Key, string | CompiledMessage> = { en, de }[language];
