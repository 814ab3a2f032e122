/** What may be done with a calibration by whom, and why not. */
import type { components } from "../../net/api.gen";
import type { NoticeKind } from "../../ui/controls";
import { t } from "../../texts";

export type Calibration = components["schemas"]["CalibrationResource"];
type Principal = components["schemas"]["PrincipalResource"];

/** Where the page shows what a calibration was made of. */
export function sourceOf(calibration: Calibration): string {
  const { identification, valves } = calibration;
  return identification === null ? `#/valves/${valves}` : `#/results/${identification}`;
}

/** Whether two calibrations are of the same, so that one takes the other's place. */
export function alike(one: Calibration, other: Calibration): boolean {
  return (one.identification === null) === (other.identification === null);
}

export const STATES: Record<Calibration["state"], [NoticeKind | "off", string]> = {
  proposed: ["info", t("calibrations.proposedWaitsApproval")],
  approved: ["info", t("calibrations.approvedNotUse")],
  active: ["good", t("calibrations.inUse")],
  rejected: ["bad", t("common.rejected")],
  retired: ["off", t("calibrations.wasInUse")],
};

export interface Possible {
  approve: boolean;
  reject: boolean;
  activate: boolean;
  /** Why something that its state would allow is not offered; null if everything is. */
  why: string | null;
}

/** The service decides; the page does not offer what it is going to refuse. */
export function possible(calibration: Calibration, principal: Principal | null, engineer: boolean): Possible {
  const { state } = calibration;
  const decided = state === "rejected" || state === "active";
  if (!engineer) {
    const why = decided ? null : t("calibrations.engineerApprovesRejectsActivates");
    return { approve: false, reject: false, activate: false, why };
  }
  const own = principal !== null && principal.id === calibration.proposed_by_id && !principal.approves_own;
  const why = state === "proposed" && own ? t("calibrations.youProposedAnotherEngineer") : null;
  return {
    approve: state === "proposed" && !own,
    reject: state === "proposed" || state === "approved",
    activate: state === "approved" || state === "retired",
    why,
  };
}

export interface Step {
  time: string;
  text: string;
}

const DONE: Record<Calibration["history"][number]["action"], string> = {
  proposed: t("common.wasProposed"),
  approved: t("common.wasApproved"),
  rejected: t("common.wasRejected"),
  activated: t("common.cameIntoUse"),
  retired: t("common.wasNoLongerUse"),
};

function told(one: Calibration, { time, action, by, note }: Calibration["history"][number]): Step {
  const same = action === "approved" && by === one.proposed_by ? t("calibrations.whoHadProposed") : "";
  return {
    time,
    text: t("calibrations.by", {
      label: one.label,
      action: DONE[action],
      by,
      same,
      note: note === "" ? "" : `: ${note}`,
    }),
  };
}

/** What happened to the calibrations of a machine, as far as each of them tells, newest first. */
export function history(calibrations: Calibration[]): Step[] {
  const steps = calibrations.flatMap((one): Step[] => {
    if (one.history.length > 0) return one.history.map((step) => told(one, step));
    const proposed = {
      time: one.created,
      text: t("calibrations.wasProposedBy", { label: one.label, proposedBy: one.proposed_by }),
    };
    if (one.activated === null) return [proposed];
    const approver = one.approved_by === null ? "" : t("calibrations.approvedBy", { approvedBy: one.approved_by });
    return [proposed, { time: one.activated, text: t("calibrations.cameIntoUse", { label: one.label, approver }) }];
  });
  return steps.sort((a, b) => b.time.localeCompare(a.time));
}

/** Notes of the service at steps that undo an activation. */
const ROLLED_BACK = t("calibrations.rolledBackTo");
const OUT_OF_USE = t("calibrations.takenOutUse");

/**
 * What rolling back leads to, null if there is none: what was put in use before the active one and not undone since, as
 * the service counts it.
 */
export function before(calibrations: Calibration[]): Calibration | null {
  if (calibrations.some((one) => one.activated !== null && one.history.length === 0)) return lastRetired(calibrations);
  const steps = calibrations
    .flatMap((one) => one.history.map((step) => ({ one, ...step })))
    .sort((a, b) => a.time.localeCompare(b.time));
  const used: Calibration[] = [];
  for (const { one, action, note } of steps) {
    const undone =
      (action === "activated" && note === ROLLED_BACK) || (action === "retired" && note.startsWith(OUT_OF_USE));
    if (undone) used.pop();
    else if (action === "activated") used.push(one);
  }
  return used[used.length - 2] ?? null;
}

/** Where a calibration does not tell its history. */
function lastRetired(calibrations: Calibration[]): Calibration | null {
  const retired = calibrations.filter((one) => one.state === "retired" && one.activated !== null);
  return retired.sort((a, b) => (b.activated as string).localeCompare(a.activated as string))[0] ?? null;
}

export interface JointError {
  joint: string;
  unit: string;
  before: number | null;
  after: number | null;
  noise: number | null;
}

/** Errors per joint of the report that a calibration was made of, on the motion that was not fitted. */
export function jointErrors(calibration: Calibration): JointError[] {
  const known = (value: unknown): number | null => (typeof value === "number" ? value : null);
  const pair = (value: unknown): number | null => {
    const { validate, train } = (value ?? {}) as { validate?: unknown; train?: unknown };
    return known(validate) ?? known(train);
  };
  return Object.entries(calibration.errors).map(([joint, given]) => {
    const errors = (given ?? {}) as Record<string, unknown>;
    return {
      joint,
      unit: typeof errors.unit === "string" ? errors.unit : "",
      before: pair(errors.before),
      after: pair(errors.after),
      noise: known(errors.noise_floor),
    };
  });
}
