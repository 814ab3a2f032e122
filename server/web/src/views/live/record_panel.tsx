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
import { t } from "../../texts";
import { said } from "../../texts/report";

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
      <Panel title={t("live.recording")} actions={<Mark kind="recording">{t("live.recording")}</Mark>}>
        <p>
          <strong>{recording.label}</strong>
          {t("live.for2", { role: ROLE_WORDS[recording.role as Role] ?? recording.role })}{" "}
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
                command.say({ kind: "good", text: t("live.recordingIsStored", { label: done.label }) });
                running.reload();
                last.reload();
              })
            }
          >
            {t("live.stopRecording")}
          </Button>
        )}
      </Panel>
    );
  return (
    <Panel title={t("live.recording")}>
      <CommandNotice of={command} />
      {!session.may("operate") ? (
        <p class="hint">{t("live.yourRoleLooksOnly2")}</p>
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
            <Field label={t("common.motion")}>
              <select value={role} onChange={(event: SelectEvent) => setRole(event.currentTarget.value as Role)}>
                {Object.entries(ROLE_WORDS).map(([name, words]) => (
                  <option key={name} value={name}>
                    {words}
                  </option>
                ))}
              </select>
            </Field>
            <Field label={t("common.labelOptional")}>
              <input
                value={label}
                maxLength={200}
                autocomplete="off"
                onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
              />
            </Field>
            <Button kind="primary" type="submit" busy={command.busy} disabled={acquired !== true || away}>
              {t("common.startRecording")}
            </Button>
          </div>
          {acquired === false && <p class="hint">{t("common.machineNotBeingAcquired")}</p>}
        </form>
      )}
      {newest !== undefined && newest.state !== "recording" && (
        <p class="hint last">
          {t("live.last", {
            label: newest.label,
            state:
              newest.state === "failed"
                ? t("live.failed", { error: said(newest.error ?? "", newest.error_message) })
                : t("live.stored"),
          })}{" "}
          <a href="#/recordings">{t("live.allRecordings")}</a>
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
