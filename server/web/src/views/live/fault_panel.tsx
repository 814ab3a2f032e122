/** Break the simulated machine, for training; shown only for a machine of `hilfit serve --simulate`. */
import { useEffect, useState } from "preact/hooks";
import { CommandNotice, useCommand } from "../../command";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, type InputEvent, type SelectEvent } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { asked, type Broken, faultWords, grouped, leftOf, targetWords } from "./faults";
import { t } from "../../texts";

type Faults = components["schemas"]["MachineFaults"];

/** ms between two looks at what is broken, while something is. */
const LOOK_MS = 1000;
const LONGEST_S = 600;

export function FaultPanel({ machine }: { machine: string }) {
  const session = useSession();
  const path = `/machines/${encodeURIComponent(machine)}/faults`;
  const faults = useResource<Faults>(path, "machines");
  const command = useCommand();
  const [fault, setFault] = useState("node_death");
  const [target, setTarget] = useState("");
  const [seconds, setSeconds] = useState("5");
  const running = (faults.value?.running ?? []) as unknown as Broken[];
  useEffect(() => {
    if (running.length === 0) return undefined;
    const timer = setInterval(() => {
      if (!document.hidden) faults.reload();
    }, LOOK_MS);
    return () => clearInterval(timer);
  }, [path, running.length > 0]);
  if (faults.value === null || !faults.value.simulated) return null;
  const offers = grouped(faults.value.offers);
  const targets = offers.get(fault) ?? [];
  const chosen = targets.find((offer) => offer.target === target) ?? targets[0];
  const wish = chosen === undefined ? null : asked(chosen, seconds, LONGEST_S);
  return (
    <Panel
      title={t("live.faultsSimulatedMachine")}
      actions={running.length > 0 && <Mark kind="warning">{t("live.broken")}</Mark>}
    >
      <CommandNotice of={command} />
      {running.map((one, number) => (
        <p key={number}>{leftOf(one)}</p>
      ))}
      {!session.may("operate") ? (
        <p class="hint">{t("live.yourRoleLooksOnly")}</p>
      ) : (
        <form
          onSubmit={(event) => {
            event.preventDefault();
            if (wish === null) return;
            void command.run({ method: "POST", path, json: { faults: [wish] } }, () => faults.reload());
          }}
        >
          <Field label={t("common.whatHappens")}>
            <select value={fault} onChange={(event: SelectEvent) => setFault(event.currentTarget.value)}>
              {[...offers.keys()].map((name) => (
                <option key={name} value={name}>
                  {faultWords(name)}
                </option>
              ))}
            </select>
          </Field>
          <Field label={t("live.toWhat")}>
            <select
              value={chosen?.target ?? ""}
              onChange={(event: SelectEvent) => setTarget(event.currentTarget.value)}
            >
              {targets.map((offer) => (
                <option key={offer.target} value={offer.target}>
                  {targetWords(offer)}
                </option>
              ))}
            </select>
          </Field>
          <Field
            label={t("live.howManySeconds")}
            error={wish === null ? t("live.giveNumberAbove0", { longests: LONGEST_S }) : undefined}
          >
            <input
              inputMode="decimal"
              value={seconds}
              onInput={(event: InputEvent) => setSeconds(event.currentTarget.value)}
            />
          </Field>
          <Button type="submit" busy={command.busy} disabled={wish === null || !session.online.value}>
            {t("common.begin")}
          </Button>
        </form>
      )}
    </Panel>
  );
}
