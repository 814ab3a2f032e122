/** Who did what: the entries, narrowed by action, and whether the log is as it was written. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { query } from "../../net/client";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Notice, type SelectEvent } from "../../ui/controls";
import { count, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { saveFile } from "../../ui/save";

type List = components["schemas"]["EntryList"];
type Entry = components["schemas"]["EntryResource"];
type Verification = components["schemas"]["VerificationResource"];

/** What an action may begin with: the resources of the service. */
const ACTIONS: [string, string][] = [
  ["", "Everything"],
  ["access", "Access: devices, keys, codes"],
  ["calibrations", "Calibrations"],
  ["identifications", "Identifications"],
  ["machines", "Machines"],
  ["recordings", "Recordings"],
  ["schedules", "Schedules"],
  ["alarms", "Alarms"],
  ["jobs", "Jobs"],
  ["backups", "Backups"],
];
const PAGE = 100;

export function AuditLog() {
  const [action, setAction] = useState("");
  const [cursors, setCursors] = useState<number[]>([0]);
  const at = cursors[cursors.length - 1] ?? 0;
  // Everything that is written anywhere may be an entry; the log has a counter of its own.
  const list = useResource<List>(`/audit${query({ limit: PAGE, action, cursor: at || null })}`, "audit");
  const items = list.value?.items ?? [];
  const next = list.value?.next ?? null;
  return (
    <div class={list.stale ? "stale" : ""}>
      <Chain />
      <Panel title="Entries, newest first">
        <div class="filters">
          <Field label="What was done">
            <select
              value={action}
              onChange={(event: SelectEvent) => {
                setAction(event.currentTarget.value);
                setCursors([0]);
              }}
            >
              {ACTIONS.map(([value, words]) => (
                <option key={value} value={value}>
                  {words}
                </option>
              ))}
            </select>
          </Field>
          <Button disabled={items.length === 0} onClick={() => saveFile(asCsv(items), "audit-log.csv")}>
            Download these as CSV
          </Button>
        </div>
        {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
        {list.value === null && list.loading && <p role="status">Reading …</p>}
        {list.value !== null && items.length === 0 && <Empty>There is no such entry.</Empty>}
        {items.length > 0 && (
          <Table
            caption="Audit log"
            columns={[
              { name: "number", title: "No.", align: "right" },
              { name: "time", title: "When" },
              { name: "principal", title: "Who" },
              { name: "action", title: "What" },
              { name: "subject", title: "Of what" },
              { name: "detail", title: "Detail" },
            ]}
            rows={items.map((entry) => ({
              key: String(entry.number),
              number: count(entry.number),
              time: time(entry.time),
              principal: entry.principal,
              action: entry.action,
              subject: <span class="detail-cell">{entry.subject}</span>,
              detail: <span class="detail-cell">{detail(entry)}</span>,
            }))}
          />
        )}
        <div class="actions">
          {cursors.length > 1 && <Button onClick={() => setCursors(cursors.slice(0, -1))}>Newer</Button>}
          {next !== null && <Button onClick={() => setCursors([...cursors, next])}>Older</Button>}
        </div>
      </Panel>
    </div>
  );
}

/** The chain of hashes, computed again when somebody asks. */
function Chain() {
  const session = useSession();
  const [found, setFound] = useState<Verification | string | null>(null);
  const [busy, setBusy] = useState(false);
  const verify = async (): Promise<void> => {
    setBusy(true);
    const outcome = await session.client.get<Verification>("/audit/verification");
    setFound(outcome.kind === "done" ? outcome.value : outcome.text);
    setBusy(false);
  };
  return (
    <Panel title="Is it as it was written?">
      {typeof found === "string" && <Notice kind="bad">{found}</Notice>}
      {found !== null && typeof found !== "string" && (
        <Notice kind={found.intact ? "good" : "bad"}>
          {found.intact
            ? `All ${count(found.entries)} entries are as they were written. `
            : `Entry ${count(found.first_broken)} is not as it was written, or one before it is missing. `}
          {found.last_hash !== null && (
            <>
              Note elsewhere, so that cutting off the newest shows later: <code>{count(found.entries)}</code> entries,
              hash <code class="detail-cell">{found.last_hash}</code>
            </>
          )}
        </Notice>
      )}
      <Button busy={busy} disabled={!session.online.value} onClick={() => void verify()}>
        Verify the chain of hashes
      </Button>
    </Panel>
  );
}

/** What else an entry says: `state: active, note: ...`. */
export function detail(entry: Entry): string {
  return Object.entries(entry.detail)
    .map(([name, value]) => `${name}: ${typeof value === "string" ? value : JSON.stringify(value)}`)
    .join(", ");
}

/** Entries as CSV (RFC 4180), times in UTC as the service has them. */
export function asCsv(entries: Entry[]): Blob {
  // A cell that a spreadsheet would take for a formula begins with an apostrophe.
  const cell = (text: string): string => `"${(/^[=+\-@\t\r]/.test(text) ? `'${text}` : text).replaceAll('"', '""')}"`;
  const rows = entries.map((entry) =>
    [String(entry.number), entry.time, entry.principal, entry.action, entry.subject, detail(entry), entry.hash]
      .map(cell)
      .join(","),
  );
  const head = "number,time,principal,action,subject,detail,hash";
  return new Blob([[head, ...rows, ""].join("\r\n")], { type: "text/csv" });
}
