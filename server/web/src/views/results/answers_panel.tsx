/** The four questions that a person has, answered on one screen. */
import type { ComponentChildren } from "preact";
import { Mark } from "../../ui/controls";
import { number, time } from "../../ui/format";
import { chance, missing, oddsWords, sure, todo } from "./answers";
import { ErrorBar } from "./joint_errors";
import { added, jointRows, overall } from "./model";
import type { Report } from "./report";
import { capital, change, verdictWords } from "./wording";

export function Verdict({ report }: { report: Report }) {
  // Reports of earlier versions say that nothing is missing where nobody looked.
  const { looked, verdict } = report.loop;
  const searched = verdict !== "not_examined" && (looked || verdict !== "nothing_missing");
  const [kind, words] = verdictWords(searched ? verdict : "not_examined");
  const all = overall(report);
  return (
    <section class={`panel verdict ${kind}`} aria-label="Verdict">
      <p>
        <Mark kind={kind}>{searched ? (report.summary?.label ?? words) : words}</Mark>{" "}
        <span class="hint">
          {report.machine}, identified {time(report.created)}
        </span>
      </p>
      <p class="sentence">{searched ? (report.summary?.sentence ?? `${words}.`) : unsearched(all.overNoise)}</p>
      <div class="answers">
        <Answer question="What was missing?">
          <MissingCauses report={report} searched={searched} />
        </Answer>
        <Answer question="How sure is that?">
          <HowSure report={report} searched={searched} />
        </Answer>
        <Answer question="How much better is it?">
          <Better report={report} />
        </Answer>
        <Answer question="What to do?">
          <ul class="plain-list">
            {todo(searched ? report : { ...report, loop: { ...report.loop, verdict: "not_examined" } }).map((text) => (
              <li key={text}>{text}</li>
            ))}
          </ul>
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
  if (!searched) return <p>Nobody looked.</p>;
  if (found.length === 0) return <p>Nothing that these recordings could show.</p>;
  return (
    <ul class="plain-list">
      {found.map((one) => (
        <li key={one.words}>
          <strong>{one.words}</strong>
          {one.probability !== null && `, probability ${chance(one.probability)}`}
        </li>
      ))}
    </ul>
  );
}

function HowSure({ report, searched }: { report: Report; searched: boolean }) {
  const { best, second, odds } = sure(report);
  if (!searched) return <p>–</p>;
  if (best === null) return <p class="hint">This report has no probabilities of explanations.</p>;
  return (
    <>
      <p>
        <strong>{chance(best.probability)}</strong> {best.words}
      </p>
      {second === null ? (
        <p class="hint">No other explanation was left.</p>
      ) : (
        <p>
          Next: {chance(second.probability)} {second.words}
          {odds !== null && <small class="margin">{capital(`margin ${oddsWords(odds)}`)}</small>}
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
            <strong>{change(all.change)}</strong> error of all joints
            {all.interval !== null && ` (95 % interval ${change(all.interval[0])} to ${change(all.interval[1])})`}.{" "}
          </>
        )}
        {all.overNoise !== null && (
          <>
            <strong>{number(all.overNoise, 3)} ×</strong> the noise
            {all.overNoiseBefore !== null && ` (before: ${number(all.overNoiseBefore, 3)} ×)`}; 1 × is the best
            possible.
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
  const error = overNoise === null ? "" : ` The error is ${number(overNoise, 3)} times the measurement noise.`;
  return `The model was fitted, and nobody looked for what it may lack.${error}`;
}
