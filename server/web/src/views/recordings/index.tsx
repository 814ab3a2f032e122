/** Recordings of the machine that is looked at: make them, bring them, take them along, identify from them. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { DASH, duration, number, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";
import { RecordPanel } from "../live/record_panel";
import { RecordingDetails } from "./details";
import { IdentifyPanel } from "./identify_panel";
import { quality, seconds } from "./quality";
import "./recordings.css";
import { type Selection, toggled } from "./selection";
import { UploadPanel } from "./upload_panel";
import { t } from "../../texts";

type List = components["schemas"]["RecordingList"];
type Recording = components["schemas"]["RecordingResource"];
type Machine = components["schemas"]["MachineDetail"];

export default function RecordingsView() {
  const machine = useSession().machine.value;
  if (machine === null)
    return (
      <>
        <h1 class="title">{t("common.recordings")}</h1>
        <Empty>{t("common.thereNoMachineYet2")}</Empty>
      </>
    );
  return <Recordings key={machine} machine={machine} />;
}

/** Most of a machine's recordings that are read at once. */
const PAGE = 200;

function Recordings({ machine }: { machine: string }) {
  const session = useSession();
  const name = encodeURIComponent(machine);
  const [most, setMost] = useState(PAGE);
  const list = useResource<List>(`/recordings?machine=${name}&limit=${most}`, "recordings");
  const detail = useResource<Machine>(`/machines/${name}`, "machines");
  const [selection, setSelection] = useState<Selection>({});
  const [open, setOpen] = useState<string | null>(null);
  const items = list.value?.items ?? [];
  const shown = items.find((one) => one.id === open);
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {t("common.recordings")} <span class="hint">{machine}</span>
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      <div class="columns">
        <RecordPanel
          machine={machine}
          acquired={detail.value === null ? null : detail.value.acquisition.state === "running"}
        />
        {items.length > 0 && (
          <IdentifyPanel
            machine={machine}
            recordings={items}
            valves={hasCommands(detail.value)}
            selection={selection}
            onRole={(id, role) => setSelection((now) => ({ ...now, [id]: role }))}
            onClear={() => setSelection({})}
          />
        )}
      </div>
      {list.value !== null && <UploadPanel machine={machine} first={items.length === 0} onDone={list.reload} />}
      {list.value !== null && (
        <Panel title={t("common.newestFirst")}>
          {items.length === 0 ? (
            <Empty>{t("recordings.nothingWasRecordedYet")}</Empty>
          ) : (
            <Table
              caption={t("recordings.recordingsNewestFirst")}
              columns={[
                ...(session.may("engineer") ? [{ name: "choose", title: t("recordings.use") }] : []),
                { name: "label", title: t("recordings.recording") },
                { name: "role", title: t("recordings.whatMachineDid") },
                { name: "quality", title: t("common.quality") },
                { name: "seconds", title: t("recordings.length"), align: "right" as const },
                { name: "size", title: t("recordings.size"), align: "right" as const },
                { name: "created", title: t("recordings.made") },
              ]}
              rows={items.map((one) => ({
                key: one.id,
                choose: <Choose recording={one} selection={selection} onChange={setSelection} />,
                label: (
                  <Button label={t("recordings.view", { label: one.label || one.id })} onClick={() => setOpen(one.id)}>
                    {one.label || one.id}
                  </Button>
                ),
                role: ROLE_WORDS[one.role as Role] ?? one.role,
                quality: <Mark kind={quality(one).kind}>{quality(one).text}</Mark>,
                seconds: one.state === "sealed" ? duration(seconds(one)) : DASH,
                size: one.bytes === null ? DASH : <span class="number-cell">{bytes(one.bytes)}</span>,
                created: time(one.created),
              }))}
            />
          )}
          {list.value.next !== null && most < 500 && (
            <Button onClick={() => setMost(500)}>{t("recordings.showOlderOnesToo")}</Button>
          )}
        </Panel>
      )}
      {shown !== undefined && (
        <RecordingDetails
          key={shown.id}
          recording={shown}
          others={items.filter((one) => one.state === "sealed" && one.id !== shown.id)}
          onClose={() => setOpen(null)}
          onDeleted={() => {
            setOpen(null);
            setSelection(({ [shown.id]: _gone, ...others }) => others);
            list.reload();
          }}
        />
      )}
    </div>
  );
}

/** Whether the machine file has a valve's command, without which there is nothing to identify of valves. */
function hasCommands(machine: Machine | null): boolean {
  const channels = (machine?.machine as { channels?: { quantity: string }[] } | undefined)?.channels ?? [];
  return channels.some((one) => one.quantity === "command");
}

interface ChooseProps {
  recording: Recording;
  selection: Selection;
  onChange: (selection: Selection) => void;
}

function Choose({ recording, selection, onChange }: ChooseProps) {
  if (recording.state !== "sealed") return null;
  return (
    <input
      type="checkbox"
      aria-label={t("recordings.useIdentification", { label: recording.label || recording.id })}
      checked={selection[recording.id] !== undefined}
      onChange={() => onChange(toggled(selection, recording))}
    />
  );
}

/** A size in bytes as people read it. */
export function bytes(size: number): string {
  if (size < 1000) return `${size} B`;
  if (size < 1e6) return t("recordings.kb", { size: number(size / 1e3, 3) });
  if (size < 1e9) return t("recordings.mb", { size: number(size / 1e6, 3) });
  return t("recordings.gb", { size: number(size / 1e9, 3) });
}
