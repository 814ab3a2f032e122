/** What is touched and what is said: buttons, fields, notices, progress. */
import type { ComponentChildren, TargetedEvent } from "preact";
import { useId } from "preact/hooks";
import { percent } from "./format";
import { t } from "../texts";

export type NoticeKind = "info" | "good" | "warning" | "bad";
export interface NoticeText {
  kind: NoticeKind;
  text: string;
}

export interface ButtonProps {
  kind?: "primary" | "plain" | "danger";
  busy?: boolean;
  disabled?: boolean;
  type?: "button" | "submit";
  label?: string;
  onClick?: (event: MouseEvent) => void;
  children: ComponentChildren;
}

/** A button; while `busy` it takes no touch and says so. */
export function Button(props: ButtonProps) {
  const { kind = "plain", busy = false, disabled = false, type = "button", label, onClick, children } = props;
  return (
    <button
      type={type}
      class={`button ${kind}`}
      disabled={disabled || busy}
      aria-busy={busy}
      {...(label === undefined ? {} : { "aria-label": label })}
      {...(onClick === undefined ? {} : { onClick })}
    >
      {busy && <span class="spinner" aria-hidden="true" />}
      {children}
    </button>
  );
}

const SIGNS: Record<NoticeKind, [string, string]> = {
  info: ["i", t("common.note")],
  good: ["✓", t("common.done")],
  warning: ["!", t("common.warning")],
  bad: ["✕", t("common.problem")],
};

/** Something to read, with a sign besides its colour. */
export function Notice({ kind, children }: { kind: NoticeKind; children: ComponentChildren }) {
  const [sign, word] = SIGNS[kind];
  return (
    <div class={`notice ${kind}`} role={kind === "bad" || kind === "warning" ? "alert" : "status"}>
      <span class="sign" aria-hidden="true">
        {sign}
      </span>
      <div>
        <span class="for-reader">{word}: </span>
        {children}
      </div>
    </div>
  );
}

/** Beside what a notice says: nothing goes on, and something is being recorded. */
const MARKS = { off: "–", recording: "●" } as const;
export type MarkKind = NoticeKind | keyof typeof MARKS;

/** A short state in words, with a sign; `kind` chooses both. */
export function Mark({ kind, children }: { kind: MarkKind; children: ComponentChildren }) {
  const sign = kind === "off" || kind === "recording" ? MARKS[kind] : SIGNS[kind][0];
  return (
    <span class={`mark ${kind}`}>
      <span class="sign" aria-hidden="true">
        {sign}
      </span>
      {children}
    </span>
  );
}

/** How far something is; `fraction` 0 to 1. */
export function Progress({ fraction, text }: { fraction: number; text: string }) {
  const value = Math.min(1, Math.max(0, fraction));
  return (
    <div class="progress">
      <progress max={1} value={value} aria-label={text} />
      <span>
        {percent(value)} {text}
      </span>
    </div>
  );
}

export interface FieldProps {
  label: string;
  hint?: string | undefined;
  error?: string | null | undefined;
  /** The control, given the id and the description that it has to carry. */
  children: ComponentChildren | ((attributes: FieldAttributes) => ComponentChildren);
}
export interface FieldAttributes {
  id: string;
  "aria-describedby"?: string;
  "aria-invalid"?: boolean;
}

/** A labelled control; a plain child is inside the label, a function gets the attributes that name it. */
export function Field({ label, hint, error, children }: FieldProps) {
  const id = useId();
  const about = [hint ? `${id}-hint` : "", error ? `${id}-error` : ""].filter(Boolean).join(" ");
  const below = (
    <>
      {hint && (
        <span class="hint" id={`${id}-hint`}>
          {hint}
        </span>
      )}
      {error && (
        <span class="error" id={`${id}-error`} role="alert">
          {error}
        </span>
      )}
    </>
  );
  if (typeof children === "function") {
    const attributes: FieldAttributes = { id };
    if (about) attributes["aria-describedby"] = about;
    if (error) attributes["aria-invalid"] = true;
    return (
      <div class="field">
        <label for={id}>{label}</label>
        {children(attributes)}
        {below}
      </div>
    );
  }
  return (
    <div class="field">
      <label>
        <span>{label}</span>
        {children}
      </label>
      {below}
    </div>
  );
}

export type InputEvent = TargetedEvent<HTMLInputElement>;
export type SelectEvent = TargetedEvent<HTMLSelectElement>;
