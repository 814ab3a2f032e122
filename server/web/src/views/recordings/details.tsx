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
    <Panel title={name} actions={<Button onClick={onClose}>Close</Button>}>
      <p class="hint">
        {recording.origin === "uploaded" ? "Uploaded" : "Recorded"} {time(recording.created)}, with version{" "}
        {recording.machine_version} of the machine file. <span class="mono">{recording.id}</span>
      </p>
      {recording.error !== null && <Notice kind="bad">{recording.error}</Notice>}
      {sealed && <Replay recording={recording} others={others} remarks={remarks.value} />}
      {sealed && (
        <>
          <h3>What the checks find</h3>
          {remarks.error !== null && <Notice kind="bad">{remarks.error}</Notice>}
          {remarks.value === null && remarks.loading && <p role="status">Checking …</p>}
          {remarks.value !== null && <Findings remarks={remarks.value} />}
          <h3>Events</h3>
          {remarks.value !== null && <Events remarks={remarks.value} />}
          {statistics.value !== null && (
            <details class="motion">
              <summary>Spectrum</summary>
              <SpectrumPlot id={recording.id} channels={Object.keys(statistics.value.channels)} />
            </details>
          )}
          <h3>Download as</h3>
          <Downloads
            files={FORMATS.map(([format, title, suffix]) => ({
              title,
              path: `/recordings/${id}/data?format=${format}`,
              name: `${recording.machine}-${recording.role}-${recording.id}${suffix}`,
            }))}
          />
        </>
      )}
      <h3>Channels</h3>
      {statistics.error !== null && <Notice kind="bad">{statistics.error}</Notice>}
      {statistics.loading && statistics.value === null && <p role="status">Reading …</p>}
      {statistics.value !== null && <Channels statistics={statistics.value} />}
      <CommandNotice of={command} />
      {recording.state !== "recording" &&
        (session.may("engineer") ? (
          <Button kind="danger" busy={command.busy} disabled={!session.online.value} onClick={() => setAsking(true)}>
            Delete
          </Button>
        ) : (
          <p class="hint">An engineer can delete a recording.</p>
        ))}
      {asking && (
        <Confirm
          title={`Delete “${name}”?`}
          text="Its file is gone then. A recording that a result was made of has to stay; the service keeps it."
          confirm="Delete it"
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
        {count(statistics.rows)} rows, {duration(statistics.seconds)} at {number(statistics.rate_hz, 3)} Hz,{" "}
        {statistics.gaps === 0 ? "no gaps" : `${statistics.gaps} gaps`}
      </p>
      <Table
        caption="Channels of the recording"
        columns={[
          { name: "name", title: "Channel" },
          { name: "quality", title: "Quality" },
          { name: "minimum", title: "Smallest", align: "right" },
          { name: "mean", title: "Mean", align: "right" },
          { name: "maximum", title: "Largest", align: "right" },
          { name: "std", title: "Std. deviation", align: "right" },
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
  if (beyond > 0) texts.push(`${count(beyond)} missing`);
  if (texts.length === 0) return <Mark kind="good">all {count(fresh || rows)} fresh</Mark>;
  return <Mark kind={channel.missing > 0.05 * rows ? "bad" : "warning"}>{texts.join(", ")}</Mark>;
}
