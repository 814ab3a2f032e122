/** One recording: channel statistics, downloads, deletion. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { count, duration, number, time } from "../../ui/format";
import { Confirm, Panel, Table } from "../../ui/layout";
import { Downloads } from "../downloads";
import { Events, Findings, SpectrumPlot } from "./remarks";
import { Replay } from "./replay";
import { t } from "../../texts";

type Recording = components["schemas"]["RecordingResource"];
type Statistics = components["schemas"]["RecordingStatistics"];
type Remarks = components["schemas"]["RecordingRemarks"];
type Channel = components["schemas"]["ChannelStatistics"];

const FORMATS: [string, string, string][] = [
  ["parquet", "Parquet", ".parquet"],
  ["csv", "CSV", ".csv"],
  ["mdf4", "MDF4", ".mf4"],
  ["mcap", "MCAP", ".mcap"],
];

interface DetailsProps {
  recording: Recording;
  /** Sealed ones of the same machine, to look at beside it. */
  others: Recording[];
  onClose: () => void;
  onDeleted: () => void;
}

export function RecordingDetails({ recording, others, onClose, onDeleted }: DetailsProps) {
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  const sealed = recording.state === "sealed";
  const id = encodeURIComponent(recording.id);
  const statistics = useResource<Statistics>(sealed ? `/recordings/${id}/statistics` : null, []);
  const remarks = useResource<Remarks>(sealed ? `/recordings/${id}/remarks` : null, []);
  const name = recording.label || recording.id;
  return (
    <Panel title={name} actions={<Button onClick={onClose}>{t("recordings.close")}</Button>}>
      <p class="hint">
        {t("recordings.withVersionMachineFile", {
          origin: recording.origin === "uploaded" ? t("recordings.uploaded") : t("recordings.recorded"),
          created: time(recording.created),
          machineVersion: recording.machine_version,
        })}{" "}
        <span class="mono">{recording.id}</span>
      </p>
      {recording.error !== null && <Notice kind="bad">{recording.error}</Notice>}
      {sealed && <Replay recording={recording} others={others} remarks={remarks.value} />}
      {sealed && (
        <>
          <h3>{t("recordings.whatChecksFind")}</h3>
          {remarks.error !== null && <Notice kind="bad">{remarks.error}</Notice>}
          {remarks.value === null && remarks.loading && <p role="status">{t("recordings.checking")}</p>}
          {remarks.value !== null && <Findings remarks={remarks.value} />}
          <h3>{t("recordings.events")}</h3>
          {remarks.value !== null && <Events remarks={remarks.value} />}
          {statistics.value !== null && (
            <details class="motion">
              <summary>{t("common.spectrum")}</summary>
              <SpectrumPlot id={recording.id} channels={Object.keys(statistics.value.channels)} />
            </details>
          )}
          <h3>{t("recordings.downloadAs")}</h3>
          <Downloads
            files={FORMATS.map(([format, title, suffix]) => ({
              title,
              path: `/recordings/${id}/data?format=${format}`,
              name: `${recording.machine}-${recording.role}-${recording.id}${suffix}`,
            }))}
          />
        </>
      )}
      <h3>{t("common.channels")}</h3>
      {statistics.error !== null && <Notice kind="bad">{statistics.error}</Notice>}
      {statistics.loading && statistics.value === null && <p role="status">{t("common.reading")}</p>}
      {statistics.value !== null && <Channels statistics={statistics.value} />}
      <CommandNotice of={command} />
      {recording.state !== "recording" &&
        (session.may("engineer") ? (
          <Button kind="danger" busy={command.busy} disabled={!session.online.value} onClick={() => setAsking(true)}>
            {t("common.delete")}
          </Button>
        ) : (
          <p class="hint">{t("recordings.engineerCanDeleteRecording")}</p>
        ))}
      {asking && (
        <Confirm
          title={t("recordings.delete", { name })}
          text={t("recordings.itsFileGoneThen")}
          confirm={t("common.deleteIt")}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            void command.run({ method: "DELETE", path: `/recordings/${id}` }, onDeleted);
          }}
        />
      )}
    </Panel>
  );
}

function Channels({ statistics }: { statistics: Statistics }) {
  return (
    <>
      <p>
        {t("recordings.rowsAtHz", {
          rows: count(statistics.rows),
          seconds: duration(statistics.seconds),
          rateHz: number(statistics.rate_hz, 3),
          gaps: statistics.gaps === 0 ? t("recordings.noGaps") : t("recordings.gaps", { gaps: statistics.gaps }),
        })}
      </p>
      <Table
        caption={t("recordings.channelsRecording")}
        columns={[
          { name: "name", title: t("recordings.channel") },
          { name: "quality", title: t("common.quality") },
          { name: "minimum", title: t("recordings.smallest"), align: "right" },
          { name: "mean", title: t("common.mean"), align: "right" },
          { name: "maximum", title: t("recordings.largest"), align: "right" },
          { name: "std", title: t("recordings.stdDeviation"), align: "right" },
        ]}
        rows={Object.entries(statistics.channels).map(([name, channel]) => ({
          key: name,
          name,
          quality: <ChannelQuality channel={channel} rows={statistics.rows} />,
          minimum: number(channel.minimum),
          mean: number(channel.mean),
          maximum: number(channel.maximum),
          std: number(channel.std, 3),
        }))}
      />
    </>
  );
}

function ChannelQuality({ channel, rows }: { channel: Channel; rows: number }) {
  const { fresh = 0, ...others } = channel.quality;
  const faults = Object.entries(others).filter(([, rows]) => rows > 0);
  const texts = faults.map(([name, rows]) => `${count(rows)} ${name}`);
  // A value that is not fresh is missing as well: what is missing beyond those has no quality to name.
  const beyond = channel.missing - faults.reduce((sum, [, rows]) => sum + rows, 0);
  if (beyond > 0) texts.push(t("recordings.missing", { beyond: count(beyond) }));
  if (texts.length === 0) return <Mark kind="good">{t("recordings.allFresh", { fresh: count(fresh || rows) })}</Mark>;
  return <Mark kind={channel.missing > 0.05 * rows ? "bad" : "warning"}>{texts.join(", ")}</Mark>;
}
