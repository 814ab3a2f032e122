/** What the service says of itself, as it says it. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { query } from "../../net/client";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, Notice, type SelectEvent } from "../../ui/controls";
import { time } from "../../ui/format";
import { Empty, Panel } from "../../ui/layout";
import { saveFile } from "../../ui/save";
import { t } from "../../texts";

type Lines = components["schemas"]["LogLines"];
export type Line = components["schemas"]["LogLine"];

const LOOK_MS = 2000;
/** Lines that the page keeps: more are in the log of the service's computer. */
const MOST = 2000;
const LEVELS: [string, string][] = [
  ["info", t("service.everything")],
  ["warning", t("service.warningsAndErrors")],
  ["error", t("service.errors")],
];

/**
 * The lines so far with what came: those after the newest that is known, at most `most`. A service that was started
 * again counts from 1, and says nothing of what was before.
 */
export function joined(known: Line[], found: Lines, asked: number, most = MOST): Line[] {
  if (found.newest < asked) return [];
  const last = known[known.length - 1]?.number ?? 0;
  return [...known, ...found.items.filter((line) => line.number > last)].slice(-most);
}

export function LogConsole() {
  const session = useSession();
  const [level, setLevel] = useState("info");
  const [containing, setContaining] = useState("");
  const [paused, setPaused] = useState(false);
  const [lines, setLines] = useState<Line[] | null>(null);
  const [error, setError] = useState<string | null>(null);
  const box = useRef<HTMLOListElement>(null);
  const follow = useRef(true);

  useEffect(() => {
    if (paused) return undefined;
    let over = false;
    let known: Line[] = [];
    let newest = 0;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const look = async (): Promise<void> => {
      const asked = newest;
      const path = `/logs${query({ level, containing, limit: 500, after: asked || null })}`;
      const outcome = document.hidden ? null : await session.client.get<Lines>(path);
      if (over) return;
      if (outcome?.kind === "done") {
        newest = outcome.value.newest < asked ? 0 : outcome.value.newest;
        const next = joined(known, outcome.value, asked);
        if (next.length !== known.length || known.length === 0 || outcome.value.items.length > 0) setLines(next);
        known = next;
        setError(null);
      } else if (outcome !== null) setError(outcome.text);
      timer = setTimeout(() => void look(), LOOK_MS);
    };
    timer = setTimeout(() => void look(), containing === "" ? 0 : 300); // somebody is typing
    return () => {
      over = true;
      clearTimeout(timer);
    };
  }, [session, level, containing, paused]);
  useEffect(() => {
    if (follow.current && box.current !== null) box.current.scrollTop = box.current.scrollHeight;
  }, [lines]);

  return (
    <Panel title={t("service.whatServiceSays")}>
      <p class="hint">{t("service.newestLinesSinceService")}</p>
      <div class="filters">
        <Field label={t("service.show")}>
          <select value={level} onChange={(event: SelectEvent) => setLevel(event.currentTarget.value)}>
            {LEVELS.map(([value, words]) => (
              <option key={value} value={value}>
                {words}
              </option>
            ))}
          </select>
        </Field>
        <Field label={t("service.containing")}>
          <input
            type="search"
            maxLength={200}
            value={containing}
            onInput={(event: InputEvent) => setContaining(event.currentTarget.value)}
          />
        </Field>
        <Button onClick={() => setPaused(!paused)}>{paused ? t("service.goOn") : t("common.pause")}</Button>
        <Button disabled={!lines?.length} onClick={() => saveFile(asText(lines ?? []), "hilfit-log.jsonl")}>
          {t("service.downloadTheseLines")}
        </Button>
      </div>
      {error !== null && <Notice kind="warning">{error}</Notice>}
      {lines === null && error === null && <p role="status">{t("common.reading")}</p>}
      {lines !== null && lines.length === 0 && <Empty>{t("service.thereNoSuchLine")}</Empty>}
      {lines !== null && lines.length > 0 && (
        <ol
          class="log-lines"
          ref={box}
          tabIndex={0}
          aria-label={t("service.linesLogOldestFirst")}
          onScroll={({ currentTarget: { scrollTop, scrollHeight, clientHeight } }) => {
            follow.current = scrollHeight - scrollTop - clientHeight < 40; // who scrolled up wants to read
          }}
        >
          {lines.map((line) => (
            <li key={line.number} class={line.level}>
              <span>{time(line.time)}</span>
              <span class="level">{line.level}</span>
              <span class="said">
                <strong>{line.event}</strong> <span class="detail">{said(line)}</span>
              </span>
            </li>
          ))}
        </ol>
      )}
    </Panel>
  );
}

/** What else a line says, and who says it. */
export function said(line: Line): string {
  const parts = Object.entries(line.detail).map(
    ([name, value]) => `${name}=${typeof value === "string" ? value : JSON.stringify(value)}`,
  );
  return [...parts, `(${line.logger})`].join(" ");
}

/** The lines as the service writes them: a JSON object each. */
function asText(lines: Line[]): Blob {
  const rows = lines.map(({ time, level, logger, event, detail }) =>
    JSON.stringify({ ...detail, timestamp: time, level, logger, event }),
  );
  return new Blob([`${rows.join("\n")}\n`], { type: "application/x-ndjson" });
}
