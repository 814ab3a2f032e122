/** One calibration: what it is, what may be done with it, its numbers. */
import { useState } from "preact/hooks";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, Mark } from "../../ui/controls";
import { change, number, time, withStd } from "../../ui/format";
import { Confirm, Table } from "../../ui/layout";
import { Downloads, reportPage } from "../downloads";
import { parameterName, unit, verdictWords } from "../results/wording";
import { type Calibration, STATES, jointErrors, possible, sourceOf } from "./rules";
import { t } from "../../texts";

type Decision = "approve" | "reject" | "activate";

const QUESTIONS: Record<Decision, [string, string, string]> = {
  approve: [t("calibrations.approve"), t("calibrations.youSayWithYour"), t("calibrations.approveIt")],
  reject: [t("calibrations.reject"), t("calibrations.cannotUsedThenResult"), t("calibrations.rejectIt")],
  activate: [t("calibrations.use"), t("calibrations.takesPlaceCalibrationUse"), t("calibrations.useFromNow")],
};

export function CalibrationCard({ calibration, onDone }: { calibration: Calibration; onDone: () => void }) {
  const session = useSession();
  const command = useCommand();
  const [asked, setAsked] = useState<Decision | null>(null);
  const [note, setNote] = useState("");
  const may = possible(calibration, session.principal.value, session.may("engineer"));
  const [kind, words] = STATES[calibration.state];
  const [, verdict] = verdictWords(calibration.verdict);
  const changed = calibration.overall.change_percent;
  const offered = (["approve", "activate", "reject"] as const).filter((one) => may[one]);
  const send = (decision: Decision): void => {
    setAsked(null);
    const path = `/calibrations/${encodeURIComponent(calibration.id)}/${decision}`;
    const order = { method: "POST", path, ...(decision === "activate" ? {} : { json: { note } }) } as const;
    void command.run(order, () => {
      setNote("");
      onDone();
    });
  };
  return (
    <li class="calibration">
      <div class="calibration-text">
        <h3>{calibration.label || calibration.id}</h3>
        <p>
          <Mark kind={kind}>{words}</Mark>
        </p>
        <p>
          {verdict}
          {typeof changed === "number" &&
            changed !== 0 &&
            t("calibrations.errorAllJoints", { changed: change(changed) })}
          . <a href={sourceOf(calibration)}>{t("common.viewTheResult")}</a>
        </p>
        <p class="hint">
          {t("calibrations.proposedBy", {
            proposedBy: calibration.proposed_by,
            created: time(calibration.created),
            approved:
              calibration.approved_by !== null
                ? t("calibrations.approvedBy", { approvedBy: calibration.approved_by })
                : "",
            used:
              calibration.activated !== null
                ? t("calibrations.inUseSince", { activated: time(calibration.activated) })
                : "",
            until: calibration.state === "retired" ? t("calibrations.untilAnotherOneWas") : "",
          })}
        </p>
        {calibration.note && <p class="note">{t("common.quoted", { text: calibration.note })}</p>}
        {may.why !== null && <p class="hint">{may.why}</p>}
      </div>
      <div class="actions">
        {offered.map((one, index) => (
          <Button
            key={one}
            kind={index === 0 && one !== "reject" && calibration.state !== "retired" ? "primary" : "plain"}
            busy={command.busy}
            disabled={!session.online.value}
            label={`${QUESTIONS[one][0]} ${calibration.label}`}
            onClick={() => setAsked(one)}
          >
            {one === "activate"
              ? calibration.state === "retired"
                ? t("calibrations.useAgain")
                : t("calibrations.use")
              : QUESTIONS[one][0]}
          </Button>
        ))}
      </div>
      <div class="wide">
        <CommandNotice of={command} />
        <Numbers calibration={calibration} />
      </div>
      {asked !== null && (
        <Confirm
          title={t("calibrations.question", { what: QUESTIONS[asked][0] ?? "", label: calibration.label })}
          text={
            <>
              <p>{QUESTIONS[asked][1]}</p>
              {asked !== "activate" && (
                <Field label={t("calibrations.noteOptional")}>
                  <textarea
                    rows={3}
                    maxLength={2000}
                    value={note}
                    onInput={(event) => setNote(event.currentTarget.value)}
                  />
                </Field>
              )}
            </>
          }
          confirm={QUESTIONS[asked][2]}
          kind={asked === "reject" ? "danger" : "primary"}
          onNo={() => setAsked(null)}
          onYes={() => send(asked)}
        />
      )}
    </li>
  );
}

function Numbers({ calibration }: { calibration: Calibration }) {
  const id = encodeURIComponent(calibration.id);
  return (
    <details>
      <summary>{t("calibrations.errorsParametersFiles")}</summary>
      <Table
        caption={t("calibrations.errorsPerJoint", { label: calibration.label })}
        columns={[
          { name: "joint", title: t("common.joint") },
          { name: "before", title: t("calibrations.withoutAdditions"), align: "right" },
          { name: "after", title: t("calibrations.error"), align: "right" },
          { name: "noise", title: t("common.noise"), align: "right" },
          { name: "unit", title: t("common.unit") },
        ]}
        rows={jointErrors(calibration).map((one) => ({
          key: one.joint,
          joint: one.joint,
          before: number(one.before, 3),
          after: <strong>{number(one.after, 3)}</strong>,
          noise: number(one.noise, 3),
          unit: unit(one.unit),
        }))}
      />
      <Table
        caption={t("calibrations.parametersOf", { label: calibration.label })}
        columns={[
          { name: "name", title: t("common.parameter") },
          { name: "value", title: t("common.valueStandardDeviation"), align: "right" },
          { name: "unit", title: t("common.unit") },
        ]}
        rows={calibration.parameters.map((one) => ({
          key: one.name,
          name: parameterName(one.name),
          value: <span class="number-cell">{withStd(one.value, one.std)}</span>,
          unit: unit(one.unit),
        }))}
      />
      <h3>{t("common.files")}</h3>
      <Downloads
        files={[
          {
            title: t("common.modelJson"),
            path: `/calibrations/${id}/model.json`,
            name: `${calibration.machine}-${calibration.id}-model.json`,
          },
          ...(calibration.identification === null
            ? []
            : [
                {
                  title: t("calibrations.reportHtml"),
                  path: reportPage(calibration.identification),
                  name: `${calibration.machine}-${calibration.id}-report.html`,
                },
              ]),
        ]}
      />
    </details>
  );
}
