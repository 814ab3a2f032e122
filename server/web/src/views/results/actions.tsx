/** What to do with a result: propose it as a calibration, take its files along. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, type InputEvent } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { Downloads, reportPage } from "../downloads";
import { t } from "../../texts";

type Calibrations = components["schemas"]["CalibrationList"];
type Calibration = components["schemas"]["CalibrationResource"];
type Identification = components["schemas"]["IdentificationResource"];

const STATES: Record<Calibration["state"], string> = {
  proposed: t("results.proposedAsCalibrationWaits"),
  approved: t("results.approvedCalibrationNotUse"),
  rejected: t("results.wasProposedAsCalibration"),
  active: t("results.calibrationUse"),
  retired: t("results.wasCalibrationUseUntil"),
};

/** Where this panel is found on the page. */
export const ACTIONS = "use-this-result";

interface ProposalProps {
  /** What a calibration may be of, and of which. */
  of: "identification" | "valves";
  source: { id: string; label: string; machine: string };
  /** Told of the calibration that it is already. */
  children?: (mine: Calibration | undefined) => ComponentChildren;
}

/** The form that proposes a result as a calibration, or what became of it. */
export function Proposal({ of, source, children }: ProposalProps) {
  const session = useSession();
  const command = useCommand();
  const [label, setLabel] = useState(source.label);
  const path = `/calibrations?machine=${encodeURIComponent(source.machine)}&limit=500`;
  const list = useResource<Calibrations>(path, "calibrations");
  const mine = list.value?.items.find((one) => one[of] === source.id);
  return (
    <>
      {mine !== undefined ? (
        <p>
          {STATES[mine.state]} <a href="#/calibrations">{t("common.calibrations")}</a>
        </p>
      ) : !session.may("operate") ? (
        <p class="hint">{t("results.yourRoleLooksOnly")}</p>
      ) : (
        list.value !== null && (
          <form
            class="inline-form"
            onSubmit={(event) => {
              event.preventDefault();
              void command.run(
                { method: "POST", path: "/calibrations", json: { [of]: source.id, label } },
                list.reload,
              );
            }}
          >
            <Field label={t("results.nameCalibration")} hint={t("results.anotherPersonApprovesBefore")}>
              <input
                value={label}
                maxLength={200}
                autocomplete="off"
                onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
              />
            </Field>
            <Button kind="primary" type="submit" busy={command.busy} disabled={!session.online.value || list.stale}>
              {t("results.proposeAsCalibration")}
            </Button>
          </form>
        )
      )}
      <CommandNotice of={command} />
      {children?.(mine)}
    </>
  );
}

export function ResultActions({ identification }: { identification: Identification }) {
  return (
    <Panel title={t("results.useThisResult")} id={ACTIONS}>
      <Proposal of="identification" source={identification}>
        {(mine) => <Files identification={identification} mine={mine} />}
      </Proposal>
    </Panel>
  );
}

function Files({ identification, mine }: { identification: Identification; mine: Calibration | undefined }) {
  const id = encodeURIComponent(identification.id);
  const name = `${identification.machine}-${identification.id}`;
  const files = [
    { title: t("results.reportReadHtml"), path: reportPage(identification.id), name: `${name}-report.html` },
    { title: t("results.reportAsDataJson"), path: `/identifications/${id}/report.json`, name: `${name}-report.json` },
  ];
  if (mine !== undefined)
    files.push({
      title: t("common.modelJson"),
      path: `/calibrations/${mine.id}/model.json`,
      name: `${name}-model.json`,
    });
  return (
    <>
      <h3>{t("common.files")}</h3>
      <Downloads files={files} />
      {mine === undefined && <p class="hint">{t("results.modelAsFileThere")}</p>}
    </>
  );
}
