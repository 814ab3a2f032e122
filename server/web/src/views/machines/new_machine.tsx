/** A new machine from its file, typed or taken from this device. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, Notice } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { storeDraft, storedDraft } from "./drafts";
import { type Fault, faultOf } from "./lines";
import { TextEditor } from "./text_editor";
import { t } from "../../texts";

type Check = components["schemas"]["MachineCheck"];
/** No machine may be called so: its draft is apart from all of theirs. */
const NEW = "/new";

export function NewMachine() {
  const session = useSession();
  const command = useCommand();
  const [text, setText] = useState(() => storedDraft(NEW)?.text ?? "");
  const [fault, setFault] = useState<Fault | null>(null);

  function keep(typed: string): void {
    setText(typed);
    setFault(null);
    storeDraft(NEW, typed === "" ? null : { text: typed, base: 0 });
  }

  async function send(path: "/machines" | "/machines/check"): Promise<void> {
    const order = { method: "POST", path, text } as const;
    const outcome = await command.run<Check>(path === "/machines" ? { ...order, etag: '"0"' } : order);
    if (outcome.kind === "refused" && outcome.status === 422) {
      setFault(faultOf(outcome.text));
      command.say(null);
    }
    if (outcome.kind === "refused" && outcome.status === 412)
      command.say({
        kind: "bad",
        text: t("machines.thereMachineNameAlready"),
      });
    if (outcome.kind !== "done") return;
    if (path === "/machines/check") {
      const { name, version } = outcome.value;
      const there = version === 1 ? "" : t("machines.butThereMachineName");
      command.say({ kind: there ? "warning" : "good", text: t("machines.serviceFindsNoFault2", { name, there }) });
      return;
    }
    storeDraft(NEW, null);
    go(`#/machines/${encodeURIComponent(outcome.value.name)}`);
  }

  if (!session.may("engineer"))
    return (
      <>
        <h1 class="title">{t("machines.newMachine")}</h1>
        <Notice kind="info">{t("machines.engineerAddsMachines")}</Notice>
      </>
    );
  return (
    <>
      <h1 class="title">{t("machines.newMachine")}</h1>
      <Panel title={t("common.machineFile")}>
        <p class="hint">
          {t("machines.fileSaysWhatJoints")} <code>name</code> {t("machines.nameMachine")}
        </p>
        <Field label={t("machines.takeFileDevice")}>
          {(attributes) => (
            <input
              {...attributes}
              type="file"
              accept=".yaml,.yml,.json"
              onChange={(event) => void event.currentTarget.files?.[0]?.text().then(keep)}
            />
          )}
        </Field>
        {fault !== null && (
          <Notice kind="bad">
            {fault.line !== null && <strong>{t("machines.line", { line: fault.line })}</strong>}
            {fault.text}
          </Notice>
        )}
        <TextEditor label={t("common.machineFile")} text={text} fault={fault} onText={keep} />
        <CommandNotice of={command} />
        <div class="actions">
          <Button
            kind="primary"
            busy={command.busy}
            disabled={text.trim() === "" || !session.online.value}
            onClick={() => void send("/machines")}
          >
            {t("machines.makeTheMachine")}
          </Button>
          <Button
            busy={command.busy}
            disabled={text.trim() === "" || !session.online.value}
            onClick={() => void send("/machines/check")}
          >
            {t("machines.check")}
          </Button>
          <a class="button" href="#/machines">
            {t("common.goBack")}
          </a>
        </div>
      </Panel>
    </>
  );
}
