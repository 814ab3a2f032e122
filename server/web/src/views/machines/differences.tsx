/** What differs between two texts, with signs besides colours. */
import { useMemo } from "preact/hooks";
import { Empty } from "../../ui/layout";
import { around, changes } from "./lines";
import { t } from "../../texts";

const SIGNS = { same: " ", removed: "−", added: "+" } as const;

export function Differences({ before, after, caption }: { before: string; after: string; caption: string }) {
  const shown = useMemo(() => around(changes(before, after)), [before, after]);
  if (shown.length === 0) return <Empty>{t("machines.thereNoDifference")}</Empty>;
  return (
    <div class="differences" role="region" aria-label={caption} tabIndex={0}>
      <ol>
        {shown.map((one, index) =>
          one === null ? (
            <li key={index} class="left-out">
              …
            </li>
          ) : (
            <li key={index} class={one.kind}>
              <span class="at">{one.line}</span>
              <span class="sign-of">{SIGNS[one.kind]}</span>
              {one.kind !== "same" && <span class="for-reader">{one.kind}: </span>}
              <code>{one.text || " "}</code>
            </li>
          ),
        )}
      </ol>
    </div>
  );
}
