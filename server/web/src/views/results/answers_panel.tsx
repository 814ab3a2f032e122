/** The four questions that a person has, answered on one screen. */
import type { ComponentChildren } from "preact";
import { Button, Mark } from "../../ui/controls";
import { change, number, time } from "../../ui/format";
import { ACTIONS } from "./actions";
import { chance, missing, oddsWords, sure, todo } from "./answers";
import { ErrorBar } from "./joint_errors";
import { added, jointRows, overall } from "./model";
import type { Report } from "./report";
import { label, sentence } from "./sentence";
import { capital, verdictWords } from "./wording";
import { t } from "../../texts";

export function Verdict({ report }: { report: Report }) {
  // Reports of earlier versions say that nothing is missing where nobody looked.
  const { looked, verdict } = report.loop;
  const searched = verdict !== "not_examined" && (looked || verdict !== "nothing_missing");
  const [kind, words] = verdictWords(searched ? verdict : "not_examined");
  const all = overall(report);
  return (
    <section class={`panel verdict ${kind}`} aria-label={t("results.verdict")}>
      <p>
        <Mark kind={kind}>{searched ? label(report) : words}</Mark>{" "}
        <span class="hint">{t("results.identified", { machine: report.machine, created: time(report.created) })}</span>
      </p>
      <p class="sentence">{searched ? sentence(report) : unsearched(all.overNoise)}</p>
      <div class="answers">
        <Answer question={t("results.whatToDo")}>
          <ul class="plain-list">
            {todo(searched ? report : { ...report, loop: { ...report.loop, verdict: "not_examined" } }).map((text) => (
              <li key={text}>{text}</li>
            ))}
          </ul>
          <Button onClick={() => document.getElementById(ACTIONS)?.scrollIntoView()}>
            {t("results.useThisResult")}
          </Button>
        </Answer>
        <Answer question={t("results.whatWasMissing")}>
          <MissingCauses report={report} searched={searched} />
        </Answer>
        <Answer question={t("results.howSure")}>
          <HowSure report={report} searched={searched} />
        </Answer>
        <Answer question={t("results.howMuchBetter")}>
          <Better report={report} />
        </Answer>
      </div>
    </section>
  );
}

function Answer({ question, children }: { question: string; children: ComponentChildren }) {
  return (
    <section class="answer">
      <h2>{question}</h2>
      {children}
    </section>
  );
}

function MissingCauses({ report, searched }: { report: Report; searched: boolean }) {
  const found = missing(report);
  if (!searched) return <p>{t("results.nobodyLooked")}</p>;
  if (found.length === 0) return <p>{t("results.nothingTheseRecordingsCould")}</p>;
  return (
    <ul class="plain-list">
      {found.map((one) => (
        <li key={one.words}>
          <strong>{one.words}</strong>
          {one.probability !== null && t("results.probability", { probability: chance(one.probability) })}
        </li>
      ))}
    </ul>
  );
}

function HowSure({ report, searched }: { report: Report; searched: boolean }) {
  const { best, second, odds } = sure(report);
  if (!searched) return <p>–</p>;
  if (best === null) return <p class="hint">{t("results.reportHasNoProbabilities")}</p>;
  return (
    <>
      <p>
        <strong>{chance(best.probability)}</strong> {best.words}
      </p>
      {second === null ? (
        <p class="hint">{t("results.noOtherExplanationWas")}</p>
      ) : (
        <p>
          {t("results.next", { probability: chance(second.probability), words: second.words })}
          {odds !== null && <small class="margin">{capital(t("results.margin", { odds: oddsWords(odds) }))}</small>}
        </p>
      )}
    </>
  );
}

function Better({ report }: { report: Report }) {
  const all = overall(report);
  const rows = jointRows(report).filter((row) => row.bar !== null);
  const both = added(report);
  return (
    <>
      <p>
        {all.change !== null && (
          <>
            <strong>{change(all.change)}</strong>{" "}
            {t("results.errorAllJoints", {
              interval:
                all.interval !== null
                  ? t("results.95IntervalTo", { interval: change(all.interval[0]), interval2: change(all.interval[1]) })
                  : "",
            })}{" "}
          </>
        )}
        {all.overNoise !== null && (
          <>
            <strong>{number(all.overNoise, 3)} ×</strong>{" "}
            {t("results.noise1BestPossible", {
              before:
                all.overNoiseBefore !== null
                  ? t("results.before", { overNoiseBefore: number(all.overNoiseBefore, 3) })
                  : "",
            })}
          </>
        )}
      </p>
      <ul class="joint-bars">
        {rows.map((row) => (
          <li key={row.joint}>
            <span>{row.named ? <strong>{row.joint}</strong> : row.joint}</span>
            <ErrorBar row={row} both={both} />
            <span class="number-cell">{row.overNoise === null ? "–" : `${number(row.overNoise, 2)} ×`}</span>
          </li>
        ))}
      </ul>
    </>
  );
}

function unsearched(overNoise: number | null): string {
  const error = overNoise === null ? "" : t("results.errorTimesMeasurementNoise", { overNoise: number(overNoise, 3) });
  return t("results.modelWasFittedNobody", { error });
}
