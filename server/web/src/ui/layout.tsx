/** Where things stand: panels, tables, dialogs, and the place of what is not there. */
import type { ComponentChildren } from "preact";
import { useId, useLayoutEffect, useRef } from "preact/hooks";
import { Button } from "./controls";
import { t } from "../texts";

export interface PanelProps {
  title: string;
  /** Where other parts of the page lead to. */
  id?: string;
  actions?: ComponentChildren;
  children: ComponentChildren;
}

/** A part of a page with its own heading. */
export function Panel({ title, id, actions, children }: PanelProps) {
  const heading = useId();
  return (
    <section class="panel" id={id} aria-labelledby={heading}>
      <header>
        <h2 id={heading}>{title}</h2>
        {actions && <div class="actions">{actions}</div>}
      </header>
      {children}
    </section>
  );
}

export interface Column {
  name: string;
  title: string;
  align?: "left" | "right" | "center";
}
export type Row = Record<string, ComponentChildren>;

/** A table; it scrolls sideways by itself where it does not fit. `key` of a row is its `key` cell, if it has one. */
export function Table({ columns, rows, caption }: { columns: Column[]; rows: Row[]; caption: string }) {
  return (
    <div class="table" role="region" aria-label={caption} tabIndex={0}>
      <table>
        <caption class="for-reader">{caption}</caption>
        <thead>
          <tr>
            {columns.map(({ name, title, align = "left" }) =>
              title === "" ? (
                <td key={name} />
              ) : (
                <th key={name} scope="col" class={align}>
                  {title}
                </th>
              ),
            )}
          </tr>
        </thead>
        <tbody>
          {rows.map((row, index) => (
            <tr key={typeof row.key === "string" ? row.key : index}>
              {columns.map((column) => (
                <td key={column.name} class={column.align ?? "left"} data-title={column.title}>
                  {row[column.name]}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** What stands where nothing is. */
export function Empty({ children }: { children: ComponentChildren }) {
  return <p class="empty">{children}</p>;
}

export interface ConfirmProps {
  title: string;
  text: ComponentChildren;
  confirm: string;
  kind?: "primary" | "danger";
  busy?: boolean;
  onYes: () => void;
  onNo: () => void;
}

/** Asks once more; Escape and the button beside say no. Show it only while it is asked. */
export function Confirm({ title, text, confirm, kind = "primary", busy = false, onYes, onNo }: ConfirmProps) {
  const id = useId();
  const dialog = useRef<HTMLDialogElement>(null);
  useLayoutEffect(() => {
    const shown = dialog.current;
    const before = document.activeElement;
    shown?.showModal();
    return () => {
      shown?.close?.(); // while it is open nothing else can have the focus
      if (before instanceof HTMLElement && before.isConnected) before.focus();
    };
  }, []);
  return (
    <dialog
      ref={dialog}
      aria-labelledby={id}
      onCancel={(event) => {
        event.preventDefault();
        onNo();
      }}
    >
      <h2 id={id}>{title}</h2>
      <div>{text}</div>
      <div class="actions">
        <Button onClick={onNo}>{t("common.noGoBack")}</Button>
        <Button kind={kind} busy={busy} onClick={onYes}>
          {confirm}
        </Button>
      </div>
    </dialog>
  );
}
