/** Sessions of devices and programs: since when, until when, last seen, what they have open; each can be ended. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button } from "../../ui/controls";
import { time } from "../../ui/format";
import { Confirm, Panel, Table } from "../../ui/layout";

type List = components["schemas"]["HolderList"];
type Holder = components["schemas"]["HolderResource"];

interface Props {
  of: "devices" | "keys";
  title: string;
  noun: string;
}

export function Holders({ of, title, noun }: Props) {
  const session = useSession();
  const devices = useResource<List>(`/access/${of}?limit=200`, "access");
  const command = useCommand();
  const [asked, setAsked] = useState<Holder | null>(null);
  return (
    <Panel title={title}>
      <CommandNotice of={command} />
      <Table
        caption={title}
        columns={[
          { name: "name", title: noun },
          { name: "role", title: "Role" },
          { name: "machines", title: "Machines" },
          { name: "created", title: "Since" },
          { name: "expires", title: "Until" },
          { name: "seen", title: "Last seen" },
          { name: "streams", title: "Open streams", align: "right" },
          { name: "action", title: "", align: "right" },
        ]}
        rows={(devices.value?.items ?? []).map((device) => ({
          key: device.id,
          name: device.name,
          role: device.role,
          machines: device.machines === null ? "all" : device.machines.join(", "),
          created: time(device.created),
          expires: device.expires === null ? "it is revoked" : time(device.expires),
          seen: device.seen === null ? "not since the start" : `${time(device.seen)}, ${device.address ?? ""}`,
          streams: String(device.streams),
          action:
            device.id === session.principal.value?.id ? (
              "this device"
            ) : (
              <Button label={`End the session of ${device.name}`} onClick={() => setAsked(device)}>
                End
              </Button>
            ),
        }))}
      />
      {asked !== null && (
        <Confirm
          title={`End the session of ${asked.name}?`}
          text="Its token is worth nothing from now on, and what it has open is closed."
          confirm="End it"
          kind="danger"
          busy={command.busy}
          onNo={() => setAsked(null)}
          onYes={() => {
            const path = `/access/${of}/${asked.id}`;
            setAsked(null);
            void command.run({ method: "DELETE", path }, devices.reload);
          }}
        />
      )}
    </Panel>
  );
}
