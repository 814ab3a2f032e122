/** Sessions of devices and programs: since when, until when, last seen, what they have open; each can be ended. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button } from "../../ui/controls";
import { time } from "../../ui/format";
import { Confirm, Panel, Table } from "../../ui/layout";
import { t } from "../../texts";
import { accessWords } from "../../words";

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
          { name: "role", title: t("pair.role") },
          { name: "machines", title: t("common.machines") },
          { name: "created", title: t("pair.since") },
          { name: "expires", title: t("pair.until") },
          { name: "seen", title: t("pair.lastSeen") },
          { name: "streams", title: t("pair.openStreams"), align: "right" },
          { name: "action", title: "", align: "right" },
        ]}
        rows={(devices.value?.items ?? []).map((device) => ({
          key: device.id,
          name: device.name,
          role: accessWords(device.role),
          machines: device.machines === null ? t("pair.all") : device.machines.join(", "),
          created: time(device.created),
          expires: device.expires === null ? t("pair.itIsRevoked") : time(device.expires),
          seen: device.seen === null ? t("pair.notSinceStart") : `${time(device.seen)}, ${device.address ?? ""}`,
          streams: String(device.streams),
          action:
            device.id === session.principal.value?.id ? (
              t("pair.thisDevice")
            ) : (
              <Button label={t("pair.endSession", { name: device.name })} onClick={() => setAsked(device)}>
                {t("pair.end")}
              </Button>
            ),
        }))}
      />
      {asked !== null && (
        <Confirm
          title={t("pair.endSession2", { name: asked.name })}
          text={t("pair.itsTokenWorthNothing")}
          confirm={t("common.endIt")}
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
