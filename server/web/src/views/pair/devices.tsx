/** Which devices are paired; each can be shut out. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand, useResource, useSession } from "../../session";
import { Button } from "../../ui/controls";
import { time } from "../../ui/format";
import { Confirm, Panel, Table } from "../../ui/layout";

type List = components["schemas"]["HolderList"];
type Holder = components["schemas"]["HolderResource"];

export function Devices() {
  const session = useSession();
  const devices = useResource<List>("/access/devices?limit=200", "access");
  const command = useCommand();
  const [asked, setAsked] = useState<Holder | null>(null);
  return (
    <Panel title="Paired devices">
      <CommandNotice of={command} />
      <Table
        caption="Paired devices"
        columns={[
          { name: "name", title: "Device" },
          { name: "role", title: "Role" },
          { name: "machines", title: "Machines" },
          { name: "created", title: "Paired" },
          { name: "action", title: "", align: "right" },
        ]}
        rows={(devices.value?.items ?? []).map((device) => ({
          key: device.id,
          name: device.name,
          role: device.role,
          machines: device.machines === null ? "all" : device.machines.join(", "),
          created: time(device.created),
          action:
            device.id === session.principal.value?.id ? (
              "this device"
            ) : (
              <Button label={`Shut out ${device.name}`} onClick={() => setAsked(device)}>
                Shut out
              </Button>
            ),
        }))}
      />
      {asked !== null && (
        <Confirm
          title={`Shut out ${asked.name}?`}
          text="The device is worth nothing from now on; it needs a new code to come back."
          confirm="Shut it out"
          kind="danger"
          busy={command.busy}
          onNo={() => setAsked(null)}
          onYes={() => {
            const path = `/access/devices/${asked.id}`;
            setAsked(null);
            void command.run({ method: "DELETE", path }, devices.reload);
          }}
        />
      )}
    </Panel>
  );
}
