/** One machine: its file in an editor, checked by the service, saved as a new version, never over somebody else's. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, Notice, type SelectEvent } from "../../ui/controls";
import { time } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { saveFile } from "../../ui/save";
import { acquisitionWords } from "../../words";
import { Differences } from "./differences";
import { MachineEditor } from "./editor";
import { useFile } from "./use_file";

type Machine = components["schemas"]["MachineDetail"];

export function MachinePage({ name }: { name: string }) {
  const machine = useResource<Machine>(`/machines/${encodeURIComponent(name)}`, ["machines", "acquisition"]);
  const session = useSession();
  const current = machine.value?.current ?? null;
  const newest = useFile(name, current);
  const state = machine.value?.acquisition.state;
  const [kind, words] = acquisitionWords(typeof state === "string" ? state : "off");
  return (
    <div class={machine.stale ? "stale" : ""}>
      <h1 class="title">{name}</h1>
      {machine.error !== null && <Notice kind="bad">{machine.error}</Notice>}
      {newest.error !== null && <Notice kind="bad">{newest.error}</Notice>}
      {machine.value !== null && (
        <p>
          <Mark kind={kind}>{words}</Mark> <span class="hint">Version {machine.value.current}, changed</span>{" "}
          <span class="hint">{time(machine.value.created)}</span>
        </p>
      )}
      {newest.file === null && newest.error === null && machine.error === null && <p role="status">Reading …</p>}
      {newest.file !== null && (
        <Panel title="Machine file">
          {!session.may("engineer") && <p class="hint">You can read it; an engineer can change it.</p>}
          <MachineEditor name={name} newest={newest.file} onSaved={machine.reload} />
        </Panel>
      )}
      {machine.value !== null && newest.file !== null && machine.value.versions.length > 1 && (
        <Versions name={name} versions={machine.value.versions} newest={newest.file.text} />
      )}
      <p>
        <a href="#/machines">All machines</a>
      </p>
    </div>
  );
}

function Versions({ name, versions, newest }: { name: string; versions: number[]; newest: string }) {
  const earlier = versions.slice(1);
  const [chosen, setChosen] = useState<number | null>(null);
  const version = chosen ?? earlier[0] ?? null;
  const old = useFile(name, version);
  return (
    <Panel title="Earlier versions">
      <Field label="Version">
        <select
          value={String(version ?? "")}
          onChange={(event: SelectEvent) => setChosen(Number(event.currentTarget.value))}
        >
          {earlier.map((one) => (
            <option key={one} value={String(one)}>
              Version {one}
            </option>
          ))}
        </select>
      </Field>
      {old.error !== null && <Notice kind="bad">{old.error}</Notice>}
      {old.file !== null && (
        <>
          <p class="hint">What changed from version {old.file.version} to the current one (− is gone, + is new):</p>
          <Differences
            before={old.file.text}
            after={newest}
            caption={`From version ${old.file.version} to the current one`}
          />
          <Button
            onClick={() => {
              if (old.file !== null) saveFile(new Blob([old.file.text]), `${name}-version-${old.file.version}.yaml`);
            }}
          >
            Download version {old.file.version}
          </Button>
        </>
      )}
    </Panel>
  );
}
