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
import { t } from "../../texts";

type Detail = components["schemas"]["MachineDetail"];

export default function PoseView() {
  const session = useSession();
  const machine = session.machine.value;
  return (
    <>
      <h1 class="title">
        {t("common.pose")} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {machine === null ? (
        <Empty>{t("common.thereNoMachineYet")}</Empty>
      ) : (
        <MachinePose key={machine} machine={machine} />
      )}
    </>
  );
}

function MachinePose({ machine }: { machine: string }) {
  const detail = useResource<Detail>(`/machines/${encodeURIComponent(machine)}`, "machines");
  const live = useLive(machine);
  void live.ticks.value; // drawn again with each value
  const arm = detail.value?.machine as unknown as (Arm & MachineContent) | undefined;
  if (arm === undefined)
    return detail.error === null ? (
      <p role="status">{t("common.reading")}</p>
    ) : (
      <Notice kind="bad">{detail.error}</Notice>
    );
  const found = positions(arm.joints, arm.channels, live.history.readings, live.silence);
  const old = live.silence >= SILENT_S;
  return (
    <>
      {old && (
        <Notice kind="warning">
          {live.history.acquisition === "running" || live.link !== "live"
            ? t("pose.noValuesComeNow")
            : t("pose.machineNotBeingAcquired")}
        </Notice>
      )}
      <div class="pose-columns">
        <Panel title={t("pose.linksAndJoints")}>
          <Drawing arm={arm} found={found} />
        </Panel>
        <Panel title={t("common.jointPositions")}>
          <Positions arm={arm} found={found} />
        </Panel>
      </div>
    </>
  );
}

const VIEWS: [string, number, number][] = [
  [t("pose.side"), 0, 0],
  [t("pose.front"), 90, 0],
  [t("pose.top"), 0, 90],
  [t("pose.oblique"), 30, 20],
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
      <div class="chart-toolbar" role="toolbar" aria-label={t("pose.whereArmLookedAt")}>
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
        {t("pose.dragTurnTipAt", {
          tip: fixed(tip[0], 3),
          tip2: fixed(tip[1], 3),
          tip3: fixed(tip[2], 3),
          size: fixed(grid(size), 2),
        })}
      </p>
      <Field label={t("pose.turnedBy", { azimuth: fixed(azimuth, 0) })}>
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
    if (q == null) return t("pose.notMeasured", { name: joint.name });
    return joint.type === "revolute"
      ? t("pose.degrees", { name: joint.name, value: fixed(q / DEGREE, 1) })
      : `${joint.name} ${fixed(q, 3)} m`;
  });
  return t("pose.tipAtM", { value: joints.join(", "), value2: tip.map((one) => fixed(one, 3)).join(", ") });
}

function Positions({ arm, found }: { arm: Arm; found: Position[] }) {
  return (
    <Table
      caption={t("pose.positionEachJoint")}
      columns={[
        { name: "joint", title: t("common.joint") },
        { name: "value", title: t("pose.position"), align: "right" },
        { name: "share", title: t("pose.ofItsRange") },
        { name: "quality", title: t("common.quality") },
      ]}
      rows={arm.joints.map((joint, index) => {
        const { q, quality } = found[index] as Position;
        const share = q === null ? null : between(joint, q);
        const turns = joint.type === "revolute";
        return {
          key: joint.name,
          joint: joint.name,
          value: q === null ? DASH : turns ? `${fixed(q / DEGREE, 1)}°` : t("pose.mm", { value: fixed(q * 1000, 1) }),
          share:
            share === null ? (
              DASH
            ) : (
              <span class="range">
                <progress
                  max={1}
                  value={within(share, 0, 1)}
                  aria-label={t("pose.ofItsRange2", { name: joint.name, share: percent(share) })}
                />
                {(share < 0 || share > 1) && <Mark kind="warning">{t("pose.outside")}</Mark>}
              </span>
            ),
          quality: <Mark kind={quality.kind}>{quality.text}</Mark>,
        };
      })}
    />
  );
}
