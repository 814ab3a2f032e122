/** All identifications of the machine that is looked at, newest first. */
import type { components } from "../../net/api.gen";
import { change } from "../../ui/format";
import { t } from "../../texts";
import { FitList } from "../fits";
import { verdictWords } from "./wording";

type Identification = components["schemas"]["IdentificationResource"];

export function ResultList() {
  return (
    <FitList<Identification>
      kind="identifications"
      view="results"
      title={t("common.results")}
      caption={t("results.identificationsNewestFirst")}
      none={t("results.nothingWasIdentifiedMachine")}
      outcome={{ title: t("results.verdict") }}
      error={{ title: t("results.errorAllJoints2"), align: "right" }}
      ended={(one) => (one.verdict === null ? null : verdictWords(one.verdict))}
      cell={(one) => <span class="number-cell">{change(changeOf(one.overall))}</span>}
    />
  );
}

function changeOf(overall: Record<string, unknown> | null): number | null {
  const value = overall?.change_percent;
  return typeof value === "number" ? value : null;
}
