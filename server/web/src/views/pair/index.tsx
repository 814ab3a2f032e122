/** Make the service know this device; and, for an admin, other devices. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go, pairingCode, pairingFingerprint } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, Notice, type InputEvent } from "../../ui/controls";
import { Confirm, Panel } from "../../ui/layout";
import { Holders } from "./devices";
import { NewCode } from "./new_code";

export default function PairView() {
  const session = useSession();
  const principal = session.principal.value;
  const code = pairingCode(location.hash);
  if (principal === null || code !== null) return <PairForm code={code ?? ""} />;
  return (
    <>
      <h1 class="title">This device</h1>
      <Panel title={principal.kind === "local" ? "This computer" : principal.name}>
        <p>
          Role: <strong>{principal.role}</strong>, machines:{" "}
          <strong>{principal.machines === null ? "all" : principal.machines.join(", ")}</strong>
        </p>
        {principal.kind === "local" ? (
          <p class="hint">The service listens on this computer only, so whoever is at it may do everything.</p>
        ) : (
          <Forget />
        )}
      </Panel>
      {session.may("admin") && principal.kind !== "local" && (
        <>
          <NewCode />
          <Holders of="devices" title="Paired devices" noun="Device" />
          <Holders of="keys" title="Keys of programs" noun="Program" />
        </>
      )}
    </>
  );
}

function Forget() {
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  return (
    <>
      <CommandNotice of={command} />
      <Button onClick={() => setAsking(true)}>Forget the service on this device</Button>
      {asking && (
        <Confirm
          title="Forget the service?"
          text="Its session ends, everywhere. This device needs a new code before it can be used again."
          confirm="Forget it"
          kind="danger"
          busy={command.busy}
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            void command.run({ method: "DELETE", path: "/access/me" }, () => session.forget());
          }}
        />
      )}
    </>
  );
}

function PairForm({ code: given }: { code: string }) {
  const session = useSession();
  const command = useCommand();
  const [code, setCode] = useState(given);
  const fingerprint = pairingFingerprint(location.hash);
  const [name, setName] = useState("");
  const [missing, setMissing] = useState<{ code?: string; name?: string }>({});

  function submit(): void {
    const found: typeof missing = {};
    if (!/^[0-9]{10}$/.test(code)) found.code = "The code has ten digits.";
    if (name.trim() === "") found.name = "Give the device a name, so that others know who did what.";
    setMissing(found);
    if (found.code !== undefined || found.name !== undefined) return;
    const json = { code, name: name.trim() };
    void command.run<components["schemas"]["Paired"]>({ method: "POST", path: "/access/pair", json }, (paired) => {
      // The code is used up; the address must not hold it any longer.
      history.replaceState(null, "", location.pathname);
      session.paired(paired.token);
      go("#/live");
    });
  }

  return (
    <Panel title="Pair this device">
      <p>
        An admin makes a code for this device, or the service shows one at its first start. It holds for a quarter of an
        hour.
      </p>
      {fingerprint !== null && (
        <Notice kind="info">
          The certificate of this service has the SHA-256 fingerprint <code>{fingerprint}</code>. Compare it with what
          the browser shows of this connection before you pair.
        </Notice>
      )}
      {session.access.value === "known" && (
        <Notice kind="info">The service knows this device already. With a new code it gets a new role.</Notice>
      )}
      <form
        onSubmit={(event) => {
          event.preventDefault();
          submit();
        }}
      >
        <Field label="Code" error={missing.code}>
          <input
            class="code"
            value={code}
            inputMode="numeric"
            maxLength={14}
            autocomplete="one-time-code"
            onInput={(event: InputEvent) => setCode(event.currentTarget.value.replace(/\D/g, ""))}
          />
        </Field>
        <Field label="Name of this device" hint="For example: tablet at the press" error={missing.name}>
          <input
            value={name}
            maxLength={80}
            autocomplete="off"
            onInput={(event: InputEvent) => setName(event.currentTarget.value)}
          />
        </Field>
        <CommandNotice of={command} />
        <Button kind="primary" type="submit" busy={command.busy}>
          Pair
        </Button>
      </form>
    </Panel>
  );
}
