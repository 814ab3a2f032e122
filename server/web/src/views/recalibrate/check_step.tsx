/** Whether every sensor measures. */
import { Button, Mark, Notice } from "../../ui/controls";
import { fixed } from "../../ui/format";
import { Empty, Table } from "../../ui/layout";
import { SILENT_S, mark, measured } from "../live/quality";
import { useLive } from "../live/use_live";
import { t } from "../../texts";

export function CheckStep({ machine, onDone }: { machine: string; onDone: () => void }) {
  const live = useLive(machine);
  void live.ticks.value; // drawn again with each value
  const readings = [...live.history.readings.values()];
  const bad = readings.filter((one) => !measured(one, live.silence) || one.quality !== "fresh");
  if (readings.length === 0 || live.silence >= SILENT_S)
    return <Empty>{live.link === "live" ? t("common.machineNotBeingAcquired") : t("common.connecting")}</Empty>;
  return (
    <>
      {bad.length === 0 ? (
        <Notice kind="good">{t("recalibrate.allSensorsMeasure", { count: readings.length })}</Notice>
      ) : (
        <Notice kind="warning">
          {t("recalibrate.sensorsHaveSomethingLook", { count: bad.length, count2: readings.length })}
        </Notice>
      )}
      {bad.length > 0 && (
        <Table
          caption={t("recalibrate.sensorsHaveSomething")}
          columns={[
            { name: "name", title: t("recalibrate.sensor") },
            { name: "value", title: t("recalibrate.value"), align: "right" },
            { name: "quality", title: t("common.quality") },
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
        {bad.length === 0 ? t("recalibrate.continue") : t("recalibrate.continueAnyway")}
      </Button>
    </>
  );
}
