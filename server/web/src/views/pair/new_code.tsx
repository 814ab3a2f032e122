/** A code for another device, to be typed or taken by its camera. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, type SelectEvent } from "../../ui/controls";
import { time } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { t } from "../../texts";
import { accessWords } from "../../words";

type Code = components["schemas"]["CodeResource"];
type Role = components["schemas"]["CodeOrder"]["role"];

const ROLES: Record<Role, string> = {
  viewer: t("pair.viewerLooksOnly"),
  operator: t("pair.operatorAlsoRecordsAcknowledges"),
  engineer: t("pair.engineerAlsoIdentifiesApproves"),
  admin: t("pair.adminAlsoPairsDevices"),
};

export function NewCode() {
  const session = useSession();
  const command = useCommand();
  const [role, setRole] = useState<Role>("operator");
  const [machines, setMachines] = useState<string[]>([]);
  const [code, setCode] = useState<Code | null>(null);
  const names = session.machines.value.map((machine) => machine.name);
  const order = { role, machines: machines.length === 0 ? null : machines };
  return (
    <Panel title={t("pair.pairAnotherDevice")}>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          setCode(null);
          void command.run<Code>({ method: "POST", path: "/access/pairing-codes", json: order }, setCode);
        }}
      >
        <Field label={t("pair.itMay")}>
          <select value={role} onChange={(event: SelectEvent) => setRole(event.currentTarget.value as Role)}>
            {Object.entries(ROLES).map(([name, words]) => (
              <option key={name} value={name}>
                {words}
              </option>
            ))}
          </select>
        </Field>
        {names.length > 0 && (
          <fieldset>
            <legend>{t("pair.onlyTheseMachinesNone")}</legend>
            {names.map((name) => (
              <label class="check" key={name}>
                <input
                  type="checkbox"
                  checked={machines.includes(name)}
                  onChange={(event: InputEvent) =>
                    setMachines(
                      event.currentTarget.checked ? [...machines, name] : machines.filter((other) => other !== name),
                    )
                  }
                />
                {name}
              </label>
            ))}
          </fieldset>
        )}
        <CommandNotice of={command} />
        <Button kind="primary" type="submit" busy={command.busy}>
          {t("pair.makeACode")}
        </Button>
      </form>
      {code !== null && (
        <div class="new-code" role="status">
          <img
            src={`data:image/svg+xml,${encodeURIComponent(code.qr_svg)}`}
            alt={t("pair.qrCodeOf", { url: code.url })}
          />
          <div>
            <p class="digits">
              {code.code.slice(0, 5)} {code.code.slice(5)}
            </p>
            <p>
              {t("pair.oneDeviceAsUntil", { role: accessWords(code.role), expires: time(code.expires) })}{" "}
              <code>{code.url}</code>
            </p>
          </div>
        </div>
      )}
    </Panel>
  );
}
