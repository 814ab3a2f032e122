/** Start and stop a recording of the machine that is looked at. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, type InputEvent, type SelectEvent } from "../../ui/controls";
import { useSecond } from "../../ui/clock";
import { duration } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";

type Recording = components["schemas"]["RecordingResource"];
type List = components["schemas"]["RecordingList"];

/** `acquired`: null while that is not known yet. */
export function RecordPanel({ machine, acquired }: { machine: string; acquired: boolean | null }) {
  const session = useSession();
  const path = `/recordings?machine=${encodeURIComponent(machine)}&limit=1`;
  const running = useResource<List>(`${path}&state=recording`, "recordings");
  const last = useResource<List>(path, "recordings");
  const command = useCommand();
  const [role, setRole] = useState<Role>("operation");
  const [label, setLabel] = useState("");
  const recording = running.value?.items[0];
  const newest = last.value?.items[0];
  const away = !session.online.value;

  if (recording !== undefined)
    return (
      <Panel title="Recording" actions={<Mark kind="recording">Recording</Mark>}>
        <p>
          <strong>{recording.label}</strong>, {ROLE_WORDS[recording.role as Role] ?? recording.role}, for{" "}
          <Since iso={recording.created} />
        </p>
        <CommandNotice of={command} />
        {session.may("operate") && (
          <Button
            kind="danger"
            busy={command.busy}
            disabled={away}
            onClick={() =>
              void command.run<Recording>({ method: "POST", path: `/recordings/${recording.id}/stop` }, (done) => {
                command.say({ kind: "good", text: `Recording “${done.label}” is stored.` });
                running.reload();
                last.reload();
              })
            }
          >
            Stop recording
          </Button>
        )}
      </Panel>
    );
  return (
    <Panel title="Recording">
      <CommandNotice of={command} />
      {!session.may("operate") ? (
        <p class="hint">Your role looks only: an operator can record.</p>
      ) : (
        <form
          onSubmit={(event) => {
            event.preventDefault();
            void command.run({ method: "POST", path: "/recordings", json: { machine, role, label } }, () => {
              setLabel("");
              running.reload();
            });
          }}
        >
          <div class="record-form">
            <Field label="Motion">
              <select value={role} onChange={(event: SelectEvent) => setRole(event.currentTarget.value as Role)}>
                {Object.entries(ROLE_WORDS).map(([name, words]) => (
                  <option key={name} value={name}>
                    {words}
                  </option>
                ))}
              </select>
            </Field>
            <Field label="Label (optional)">
              <input
                value={label}
                maxLength={200}
                autocomplete="off"
                onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
              />
            </Field>
            <Button kind="primary" type="submit" busy={command.busy} disabled={acquired !== true || away}>
              Start recording
            </Button>
          </div>
          {acquired === false && <p class="hint">The machine is not being acquired now.</p>}
        </form>
      )}
      {newest !== undefined && newest.state !== "recording" && (
        <p class="hint last">
          Last: {newest.label}, {newest.state === "failed" ? `failed: ${newest.error ?? ""}` : "stored"}.{" "}
          <a href="#/recordings">All recordings</a>
        </p>
      )}
    </Panel>
  );
}

/** How long since a time of the service, counted on. */
export function Since({ iso }: { iso: string }) {
  const now = useSecond();
  return <>{duration((now - new Date(iso).getTime()) / 1000)}</>;
}
