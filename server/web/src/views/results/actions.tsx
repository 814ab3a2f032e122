/** What to do with a result: propose it as a calibration, take its files along. */
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

export function ResultActions({ identification }: { identification: Identification }) {
  const session = useSession();
  const command = useCommand();
  const [label, setLabel] = useState(identification.label);
  const path = `/calibrations?machine=${encodeURIComponent(identification.machine)}&limit=500`;
  const list = useResource<Calibrations>(path, "calibrations");
  const mine = list.value?.items.find((one) => one.identification === identification.id);
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
    <Panel title={t("results.useThisResult")} id={ACTIONS}>
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
              const json = { identification: identification.id, label };
              void command.run({ method: "POST", path: "/calibrations", json }, list.reload);
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
      <h3>{t("common.files")}</h3>
      <Downloads files={files} />
      {mine === undefined && <p class="hint">{t("results.modelAsFileThere")}</p>}
    </Panel>
  );
}
