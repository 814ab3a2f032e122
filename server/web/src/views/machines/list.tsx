/** All machines, and whether each is acquired. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { time } from "../../ui/format";
import { Confirm, Empty, Panel, Table } from "../../ui/layout";
import { acquisitionWords } from "../../words";
import { t } from "../../texts";

type List = components["schemas"]["MachineList"];
type Machine = components["schemas"]["MachineSummary"];
type Status = components["schemas"]["Status"];

export function MachineList() {
  const session = useSession();
  const list = useResource<List>("/machines?limit=500", "machines");
  const status = useResource<Status>("/status", ["machines", "acquisition"]);
  const command = useCommand();
  const [asked, setAsked] = useState<Machine | null>(null);
  const items = list.value?.items ?? [];
  const engineer = session.may("engineer");
  const state = (machine: Machine): string => {
    const known = status.value?.acquisition[machine.name]?.state;
    return machine.acquire ? (typeof known === "string" ? known : "starting") : "off";
  };
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">{t("common.machines")}</h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {list.value !== null && (
        <Panel title={t("common.allMachines")}>
          <CommandNotice of={command} />
          {items.length === 0 ? (
            <Empty>{t("machines.thereNoMachineYet")}</Empty>
          ) : (
            <Table
              caption={t("common.machines")}
              columns={[
                { name: "name", title: t("common.machine") },
                { name: "state", title: t("machines.acquisition") },
                { name: "version", title: t("machines.versionItsFile"), align: "right" },
                { name: "created", title: t("machines.changed") },
                ...(engineer ? [{ name: "switch", title: "", align: "right" as const }] : []),
              ]}
              rows={items.map((one) => ({
                key: one.name,
                name: (
                  <a class="row-link" href={`#/machines/${encodeURIComponent(one.name)}`}>
                    {one.name}
                  </a>
                ),
                state: <Mark kind={acquisitionWords(state(one))[0]}>{acquisitionWords(state(one))[1]}</Mark>,
                version: one.version,
                created: time(one.created),
                switch: (
                  <Button
                    busy={command.busy}
                    disabled={!session.online.value}
                    label={t(one.acquire ? "machines.stopAcquiringOne" : "machines.startAcquiringOne", {
                      name: one.name,
                    })}
                    onClick={() => (one.acquire ? setAsked(one) : acquire(one.name, true))}
                  >
                    {one.acquire ? t("machines.stopAcquiring") : t("machines.acquire")}
                  </Button>
                ),
              }))}
            />
          )}
        </Panel>
      )}
      {engineer ? (
        <Button kind="primary" onClick={() => go("#/machines?new=1")}>
          {t("machines.newMachine")}
        </Button>
      ) : (
        <p class="hint">{t("machines.engineerAddsMachinesChanges")}</p>
      )}
      {asked !== null && (
        <Confirm
          title={t("machines.stopAcquiring2", { name: asked.name })}
          text={t("machines.nothingMeasuredWatchedRecorded")}
          confirm={t("machines.stopAcquiring")}
          kind="danger"
          onNo={() => setAsked(null)}
          onYes={() => {
            setAsked(null);
            acquire(asked.name, false);
          }}
        />
      )}
    </div>
  );

  function acquire(name: string, enabled: boolean): void {
    const path = `/machines/${encodeURIComponent(name)}/acquisition`;
    void command.run({ method: "PUT", path, json: { enabled } }, () => {
      list.reload();
      status.reload();
    });
  }
}
