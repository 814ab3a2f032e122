/** Whether every sensor measures. */
import { Button, Mark, Notice } from "../../ui/controls";
import { fixed } from "../../ui/format";
import { Empty, Table } from "../../ui/layout";
import { SILENT_S, mark, measured } from "../live/quality";
import { useLive } from "../live/use_live";

export function CheckStep({ machine, onDone }: { machine: string; onDone: () => void }) {
  const live = useLive(machine);
  const readings = [...live.history.readings.values()];
  const bad = readings.filter((one) => !measured(one, live.silence) || one.quality !== "fresh");
  if (readings.length === 0 || live.silence >= SILENT_S)
    return <Empty>{live.link === "live" ? "The machine is not being acquired now." : "Connecting …"}</Empty>;
  return (
    <>
      {bad.length === 0 ? (
        <Notice kind="good">All {readings.length} sensors measure.</Notice>
      ) : (
        <Notice kind="warning">
          {bad.length} of {readings.length} sensors have something. Look at cable, node and supply; what is recorded
          without them is worth less.
        </Notice>
      )}
      {bad.length > 0 && (
        <Table
          caption="Sensors that have something"
          columns={[
            { name: "name", title: "Sensor" },
            { name: "value", title: "Value", align: "right" },
            { name: "quality", title: "Quality" },
          ]}
          rows={bad.map((one) => {
            const quality = mark(one, live.silence);
            return {
              key: one.name,
              name: one.name,
              value: `${fixed(one.value, 3)} ${one.unit}`,
              quality: <Mark kind={quality.kind}>{quality.text}</Mark>,
            };
          })}
        />
      )}
      <Button kind={bad.length === 0 ? "primary" : "plain"} onClick={onDone}>
        {bad.length === 0 ? "Continue" : "Continue anyway"}
      </Button>
    </>
  );
}
