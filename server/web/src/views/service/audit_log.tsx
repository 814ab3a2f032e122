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
import { t } from "../../texts";

type List = components["schemas"]["EntryList"];
type Entry = components["schemas"]["EntryResource"];
type Verification = components["schemas"]["VerificationResource"];

/** What an action may begin with: the resources of the service. */
const ACTIONS: [string, string][] = [
  ["", t("service.everything")],
  ["access", t("service.accessDevicesKeysCodes")],
  ["calibrations", t("common.calibrations")],
  ["identifications", t("service.identifications")],
  ["machines", t("common.machines")],
  ["recordings", t("common.recordings")],
  ["schedules", t("common.schedules")],
  ["alarms", t("common.alarms")],
  ["jobs", t("common.jobs")],
  ["backups", t("service.backups")],
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
      <Panel title={t("service.entriesNewestFirst")}>
        <div class="filters">
          <Field label={t("service.whatWasDone")}>
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
            {t("service.downloadTheseAsCsv")}
          </Button>
        </div>
        {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
        {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
        {list.value !== null && items.length === 0 && <Empty>{t("service.thereNoSuchEntry")}</Empty>}
        {items.length > 0 && (
          <Table
            caption={t("service.auditLog")}
            columns={[
              { name: "number", title: t("service.number"), align: "right" },
              { name: "time", title: t("common.when") },
              { name: "principal", title: t("service.who") },
              { name: "action", title: t("service.what") },
              { name: "subject", title: t("service.ofWhat") },
              { name: "detail", title: t("service.detail") },
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
          {cursors.length > 1 && <Button onClick={() => setCursors(cursors.slice(0, -1))}>{t("service.newer")}</Button>}
          {next !== null && <Button onClick={() => setCursors([...cursors, next])}>{t("service.older")}</Button>}
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
    <Panel title={t("service.asWasWritten")}>
      {typeof found === "string" && <Notice kind="bad">{found}</Notice>}
      {found !== null && typeof found !== "string" && (
        <Notice kind={found.intact ? "good" : "bad"}>
          {found.intact
            ? t("service.allEntriesAsThey", { entries: count(found.entries) })
            : t("service.entryNotAsWas", { firstBroken: count(found.first_broken) })}
          {found.last_hash !== null && (
            <>
              {t("service.noteElsewhereSoCutting")} <code>{count(found.entries)}</code> {t("service.entriesHash")}{" "}
              <code class="detail-cell">{found.last_hash}</code>
            </>
          )}
        </Notice>
      )}
      <Button busy={busy} disabled={!session.online.value} onClick={() => void verify()}>
        {t("service.verifyChainHashes")}
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
