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
import { t } from "../../texts";
import { accessWords } from "../../words";

export default function PairView() {
  const session = useSession();
  const principal = session.principal.value;
  const code = pairingCode(location.hash);
  if (principal === null || code !== null) return <PairForm code={code ?? ""} />;
  return (
    <>
      <h1 class="title">{t("pair.thisDevice2")}</h1>
      <Panel title={principal.kind === "local" ? t("pair.thisComputer") : principal.name}>
        <p>
          {t("pair.role2")} <strong>{accessWords(principal.role)}</strong>
          {t("pair.machines")}{" "}
          <strong>{principal.machines === null ? t("pair.all") : principal.machines.join(", ")}</strong>
        </p>
        {principal.kind === "local" ? <p class="hint">{t("pair.serviceListensComputerOnly")}</p> : <Forget />}
      </Panel>
      {session.may("admin") && principal.kind !== "local" && (
        <>
          <NewCode />
          <Holders of="devices" title={t("pair.pairedDevices")} noun={t("common.device")} />
          <Holders of="keys" title={t("pair.keysOfPrograms")} noun={t("pair.program")} />
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
      <Button onClick={() => setAsking(true)}>{t("pair.forgetServiceDevice")}</Button>
      {asking && (
        <Confirm
          title={t("pair.forgetTheService")}
          text={t("pair.itsSessionEndsEverywhere")}
          confirm={t("pair.forgetIt")}
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
    if (!/^[0-9]{10}$/.test(code)) found.code = t("pair.codeHasTenDigits");
    if (name.trim() === "") found.name = t("pair.giveDeviceNameSo");
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
    <Panel title={t("common.pairThisDevice")}>
      <p>{t("pair.adminMakesCodeDevice")}</p>
      {fingerprint !== null && (
        <Notice kind="info">
          {t("pair.certificateServiceHasSha")} <code>{fingerprint}</code>
          {t("pair.compareWithWhatBrowser")}
        </Notice>
      )}
      {session.access.value === "known" && <Notice kind="info">{t("pair.serviceKnowsDeviceAlready")}</Notice>}
      <form
        onSubmit={(event) => {
          event.preventDefault();
          submit();
        }}
      >
        <Field label={t("pair.code")} error={missing.code}>
          <input
            class="code"
            value={code}
            inputMode="numeric"
            maxLength={14}
            autocomplete="one-time-code"
            onInput={(event: InputEvent) => setCode(event.currentTarget.value.replace(/\D/g, ""))}
          />
        </Field>
        <Field label={t("pair.nameDevice")} hint={t("pair.exampleTabletAtPress")} error={missing.name}>
          <input
            value={name}
            maxLength={80}
            autocomplete="off"
            onInput={(event: InputEvent) => setName(event.currentTarget.value)}
          />
        </Field>
        <CommandNotice of={command} />
        <Button kind="primary" type="submit" busy={command.busy}>
          {t("pair.pair")}
        </Button>
      </form>
    </Panel>
  );
}
