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
      <h1 class="title">Machines</h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">Reading …</p>}
      {list.value !== null && (
        <Panel title="All machines">
          <CommandNotice of={command} />
          {items.length === 0 ? (
            <Empty>There is no machine yet. An engineer makes one from a machine file.</Empty>
          ) : (
            <Table
              caption="Machines"
              columns={[
                { name: "name", title: "Machine" },
                { name: "state", title: "Acquisition" },
                { name: "version", title: "Version of its file", align: "right" },
                { name: "created", title: "Changed" },
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
                    label={`${one.acquire ? "Stop" : "Start"} acquiring ${one.name}`}
                    onClick={() => (one.acquire ? setAsked(one) : acquire(one.name, true))}
                  >
                    {one.acquire ? "Stop acquiring" : "Acquire"}
                  </Button>
                ),
              }))}
            />
          )}
        </Panel>
      )}
      {engineer ? (
        <Button kind="primary" onClick={() => go("#/machines?new=1")}>
          New machine
        </Button>
      ) : (
        <p class="hint">An engineer adds machines, changes their files and switches acquisition.</p>
      )}
      {asked !== null && (
        <Confirm
          title={`Stop acquiring ${asked.name}?`}
          text="Nothing is measured, watched or recorded from then on, and schedules miss their times. It stays so over restarts."
          confirm="Stop acquiring"
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
