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

type List = components["schemas"]["RecordingList"];
type Recording = components["schemas"]["RecordingResource"];
type Machine = components["schemas"]["MachineDetail"];

export default function RecordingsView() {
  const machine = useSession().machine.value;
  if (machine === null)
    return (
      <>
        <h1 class="title">Recordings</h1>
        <Empty>There is no machine yet. An engineer adds one under Machines.</Empty>
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
        Recordings <span class="hint">{machine}</span>
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">Reading …</p>}
      <div class="columns">
        <RecordPanel
          machine={machine}
          acquired={detail.value === null ? null : detail.value.acquisition.state === "running"}
        />
        <UploadPanel machine={machine} onDone={list.reload} />
      </div>
      {list.value !== null && (
        <Panel title="Newest first">
          {items.length === 0 ? (
            <Empty>Nothing was recorded yet.</Empty>
          ) : (
            <Table
              caption="Recordings, newest first"
              columns={[
                ...(session.may("engineer") ? [{ name: "choose", title: "Use" }] : []),
                { name: "label", title: "Recording" },
                { name: "role", title: "What the machine did" },
                { name: "quality", title: "Quality" },
                { name: "seconds", title: "Length", align: "right" as const },
                { name: "size", title: "Size", align: "right" as const },
                { name: "created", title: "Made" },
              ]}
              rows={items.map((one) => ({
                key: one.id,
                choose: <Choose recording={one} selection={selection} onChange={setSelection} />,
                label: (
                  <Button label={`View ${one.label || one.id}`} onClick={() => setOpen(one.id)}>
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
          {list.value.next !== null && most < 500 && <Button onClick={() => setMost(500)}>Show older ones too</Button>}
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
      {items.length > 0 && (
        <IdentifyPanel
          machine={machine}
          recordings={items}
          selection={selection}
          onRole={(id, role) => setSelection((now) => ({ ...now, [id]: role }))}
          onClear={() => setSelection({})}
        />
      )}
    </div>
  );
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
      aria-label={`Use ${recording.label || recording.id} for an identification`}
      checked={selection[recording.id] !== undefined}
      onChange={() => onChange(toggled(selection, recording))}
    />
  );
}

/** A size in bytes as people read it. */
export function bytes(size: number): string {
  if (size < 1000) return `${size} B`;
  if (size < 1e6) return `${number(size / 1e3, 3)} kB`;
  if (size < 1e9) return `${number(size / 1e6, 3)} MB`;
  return `${number(size / 1e9, 3)} GB`;
}
