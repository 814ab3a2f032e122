/** How the arm stands now: its links drawn from the machine file and the measured joint positions. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, Mark, Notice } from "../../ui/controls";
import { DASH, fixed, percent } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { useWidth } from "../../ui/width";
import type { MachineContent } from "../live/groups";
import { SILENT_S } from "../live/quality";
import { useLive } from "../live/use_live";
import { type Arm, pose, type Vector } from "./kinematics";
import { between, middle, type Position, positions } from "./positions";
import { projected, reach, view } from "./projection";
import "./pose.css";

type Detail = components["schemas"]["MachineDetail"];

export default function PoseView() {
  const session = useSession();
  const machine = session.machine.value;
  return (
    <>
      <h1 class="title">Pose {machine !== null && <span class="hint">{machine}</span>}</h1>
      {machine === null ? <Empty>There is no machine yet.</Empty> : <MachinePose key={machine} machine={machine} />}
    </>
  );
}

function MachinePose({ machine }: { machine: string }) {
  const detail = useResource<Detail>(`/machines/${encodeURIComponent(machine)}`, "machines");
  const live = useLive(machine);
  const arm = detail.value?.machine as unknown as (Arm & MachineContent) | undefined;
  if (arm === undefined)
    return detail.error === null ? <p role="status">Reading …</p> : <Notice kind="bad">{detail.error}</Notice>;
  const found = positions(arm.joints, arm.channels, live.history.readings, live.silence);
  const old = live.silence >= SILENT_S;
  return (
    <>
      {old && (
        <Notice kind="warning">
          {live.history.acquisition === "running" || live.link !== "live"
            ? "No values come now; the drawing is not the arm as it stands."
            : "The machine is not being acquired now; the drawing is not the arm as it stands."}
        </Notice>
      )}
      <div class="pose-columns">
        <Panel title="Links and joints">
          <Drawing arm={arm} found={found} />
        </Panel>
        <Panel title="Joint positions">
          <Positions arm={arm} found={found} />
        </Panel>
      </div>
    </>
  );
}

const VIEWS: [string, number, number][] = [
  ["Side", 0, 0],
  ["Front", 90, 0],
  ["Top", 0, 90],
  ["Oblique", 30, 20],
];
const DEGREE = Math.PI / 180;

export function Drawing({ arm, found }: { arm: Arm; found: Position[] }) {
  const [place, width] = useWidth<HTMLDivElement>(600);
  const [[azimuth, elevation], look] = useState<[number, number]>([30, 20]);
  const [held, hold] = useState<[number, number] | null>(null);
  const q = arm.joints.map((joint, index) => found[index]?.q ?? middle(joint));
  const now = pose(arm, q);
  const seen = view(arm, azimuth * DEGREE, elevation * DEGREE);
  const size = reach(arm);
  const height = Math.min(520, Math.max(280, width * 0.75));
  const scale = Math.min(width, height) / (2.15 * size);
  const at = (point: Vector): [number, number] => {
    const [right, up] = projected(point, seen);
    return [width / 2 + scale * right, height / 2 - scale * up];
  };
  const text = (point: Vector): string => at(point).join(" ");
  const tip = now.frames[now.frames.length - 1]?.origin ?? [0, 0, 0];
  return (
    <div ref={place} class="pose">
      <div class="chart-toolbar" role="toolbar" aria-label="Where the arm is looked at from">
        {VIEWS.map(([name, turned, raised]) => (
          <Button key={name} onClick={() => look([turned, raised])}>
            {name}
          </Button>
        ))}
      </div>
      <svg
        width={width}
        height={height}
        role="img"
        aria-label={inWords(arm, found, tip)}
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          hold([event.clientX, event.clientY]);
        }}
        onPointerMove={(event) => {
          if (held === null) return;
          look([azimuth - (event.clientX - held[0]) / 2, within(elevation + (event.clientY - held[1]) / 2, -90, 90)]);
          hold([event.clientX, event.clientY]);
        }}
        onPointerUp={() => hold(null)}
        onPointerCancel={() => hold(null)}
      >
        <path class="ground" d={ground(arm, size, seen, text)} />
        {now.links.map((points, index) => (
          <path
            key={index}
            class={found[index]?.q == null ? "link unknown" : "link"}
            d={`M${points.map(text).join("L")}`}
          />
        ))}
        {now.joints.map(({ at: point }, index) => {
          const [x, y] = at(point);
          const name = arm.joints[index]?.name ?? "";
          return (
            <g key={name}>
              <circle class={found[index]?.q == null ? "joint unknown" : "joint"} cx={x} cy={y} r={7} />
              <text x={x + 6} y={index % 2 === 0 ? y - 13 : y + 25}>
                {name}
              </text>
            </g>
          );
        })}
        <circle class="tip" cx={at(tip)[0]} cy={at(tip)[1]} r={5} />
      </svg>
      <p class="hint">
        Drag to turn it. The tip is at {fixed(tip[0], 3)}, {fixed(tip[1], 3)}, {fixed(tip[2], 3)} m of the base frame;
        gravity points down. Grid: {fixed(grid(size), 2)} m. Links are straight lines along the table of the machine
        file.
      </p>
      <Field label={`Turned by ${fixed(azimuth, 0)}°`}>
        <input
          type="range"
          min={-180}
          max={180}
          step={5}
          value={azimuth}
          onInput={(event: InputEvent) => look([Number(event.currentTarget.value), elevation])}
        />
      </Field>
    </div>
  );
}

const within = (value: number, low: number, high: number): number => Math.min(high, Math.max(low, value));

/** Distance of the grid's lines, m: 1, 2 or 5 of a power of ten, about a quarter of the reach. */
export function grid(size: number): number {
  const power = 10 ** Math.floor(Math.log10(size / 4));
  return ([5, 2, 1].find((one) => one * power <= size / 4) ?? 1) * power;
}

/** A horizontal grid through the base. */
function ground(arm: Arm, size: number, seen: ReturnType<typeof view>, text: (point: Vector) => string): string {
  const level = view(arm, 0, 0);
  const [u, v] = [level.right, level.towards];
  const step = grid(size);
  const lines = Math.floor(size / step);
  const end = lines * step;
  const point = (a: number, b: number): Vector => [a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]];
  const paths: string[] = [];
  for (let line = -lines; line <= lines; line += 1) {
    paths.push(`M${text(point(line * step, -end))}L${text(point(line * step, end))}`);
    paths.push(`M${text(point(-end, line * step))}L${text(point(end, line * step))}`);
  }
  return seen.towards.every(Number.isFinite) ? paths.join("") : "";
}

function inWords(arm: Arm, found: Position[], tip: Vector): string {
  const joints = arm.joints.map((joint, index) => {
    const q = found[index]?.q;
    if (q == null) return `${joint.name} not measured`;
    return joint.type === "revolute"
      ? `${joint.name} ${fixed(q / DEGREE, 1)} degrees`
      : `${joint.name} ${fixed(q, 3)} m`;
  });
  return `${joints.join(", ")}; tip at ${tip.map((one) => fixed(one, 3)).join(", ")} m`;
}

function Positions({ arm, found }: { arm: Arm; found: Position[] }) {
  return (
    <Table
      caption="Joint positions"
      columns={[
        { name: "joint", title: "Joint" },
        { name: "value", title: "Position", align: "right" },
        { name: "share", title: "Of its range" },
        { name: "quality", title: "Quality" },
      ]}
      rows={arm.joints.map((joint, index) => {
        const { q, quality } = found[index] as Position;
        const share = q === null ? null : between(joint, q);
        const turns = joint.type === "revolute";
        return {
          key: joint.name,
          joint: joint.name,
          value: q === null ? DASH : turns ? `${fixed(q / DEGREE, 1)}°` : `${fixed(q * 1000, 1)} mm`,
          share:
            share === null ? (
              DASH
            ) : (
              <span class="range">
                <progress
                  max={1}
                  value={within(share, 0, 1)}
                  aria-label={`${joint.name}: ${percent(share)} of its range`}
                />
                {(share < 0 || share > 1) && <Mark kind="warning">outside</Mark>}
              </span>
            ),
          quality: <Mark kind={quality.kind}>{quality.text}</Mark>,
        };
      })}
    />
  );
}
